/* OpenSceneGraph culls a scene, view by view, and tells what is left: no window and no OpenGL.
 *
 * Reads from standard input, writes a line for each view to standard output. record.py speaks with it:
 *   option NAME VALUE           culling, small_feature_px, near_far, occluders, shadow_volume, nested: see main()
 *   object V T                  then V lines x y z, T lines of three corners; objects are numbered from 0
 *   occluder OBJECT             then four lines x y z, in the object's space; stands beside the Geode, or,
 *                               where nested, is put in above it
 *   pose OBJECT M               its matrix, 16 numbers by rows; it has none before
 *   present OBJECT 0|1
 *   view WIDTH HEIGHT P V       projection and view matrix, by rows; answers: near far object object ...
 *
 * What is told is in the state graph after SceneView::cull, which is what SceneView::draw goes through. */
#include <osg/FrameStamp>
#include <osg/Geode>
#include <osg/Geometry>
#include <osg/MatrixTransform>
#include <osg/OccluderNode>
#include <osgUtil/SceneView>

#include <cstdlib>
#include <iomanip>
#include <iostream>
#include <set>
#include <string>
#include <vector>

namespace {

std::istream &in = std::cin;

[[noreturn]] void give_up(const std::string &why) {
    std::cerr << why << "\n";
    std::exit(2);
}

template <class T> T read() {
    T value;
    if (!(in >> value)) give_up("the input ends too soon, or is no number");
    return value;
}

osg::Vec3 read_point() {
    double x = read<double>(), y = read<double>(), z = read<double>();
    return osg::Vec3(x, y, z);
}

/* OpenSceneGraph multiplies rows of points from the left: its matrix is the transpose of ours. */
osg::Matrixd read_matrix() {
    osg::Matrixd matrix;
    for (int row = 0; row < 4; row++)
        for (int column = 0; column < 4; column++) matrix(column, row) = read<double>();
    return matrix;
}

class Numbered : public osg::Referenced {
  public:
    explicit Numbered(size_t number) : number(number) {}
    const size_t number;
};

osg::ref_ptr<osg::Geometry> read_geometry(size_t number) {
    size_t vertex_count = read<size_t>(), triangle_count = read<size_t>();
    osg::ref_ptr<osg::Vec3Array> vertices = new osg::Vec3Array;
    osg::ref_ptr<osg::DrawElementsUInt> corners = new osg::DrawElementsUInt(GL_TRIANGLES);
    for (size_t i = 0; i < vertex_count; i++) vertices->push_back(read_point());
    for (size_t i = 0; i < 3 * triangle_count; i++) corners->push_back(read<unsigned>());
    osg::ref_ptr<osg::Geometry> geometry = new osg::Geometry;
    geometry->setVertexArray(vertices);
    geometry->addPrimitiveSet(corners);
    geometry->setUserData(new Numbered(number));
    return geometry;
}

osg::ref_ptr<osg::OccluderNode> read_occluder() {
    osg::ref_ptr<osg::ConvexPlanarOccluder> occluder = new osg::ConvexPlanarOccluder;
    for (int i = 0; i < 4; i++) occluder->getOccluder().add(read_point());
    osg::ref_ptr<osg::OccluderNode> node = new osg::OccluderNode;
    node->setOccluder(occluder);
    return node;
}

void collect(const osgUtil::StateGraph &graph, std::set<size_t> &found) {
    for (const auto &leaf : graph._leaves) {
        const auto *own = dynamic_cast<const Numbered *>(leaf->getDrawable()->getUserData());
        if (own) found.insert(own->number);
    }
    for (const auto &child : graph._children) collect(*child.second, found);
}

} // namespace

int main() {
    osg::ref_ptr<osg::Group> root = new osg::Group;
    std::vector<osg::ref_ptr<osg::MatrixTransform>> objects;
    osg::ref_ptr<osgUtil::SceneView> view = new osgUtil::SceneView;
    view->setDefaults();
    view->setInitVisitor(nullptr); // it would compile for OpenGL
    view->setSceneData(root);
    if (!view->getCollectOccludersVisitor()) view->setCollectOccludersVisitor(new osg::CollectOccludersVisitor);
    osg::ref_ptr<osg::FrameStamp> stamp = new osg::FrameStamp;
    std::ios::sync_with_stdio(false);
    std::cout << std::setprecision(17);

    auto object = [&]() -> osg::MatrixTransform & {
        size_t number = read<size_t>();
        if (number >= objects.size()) give_up("there is no such object");
        return *objects[number];
    };
    std::string word;
    unsigned frame = 0;
    bool nested = false;
    while (in >> word) {
        if (word == "option") {
            std::string name = read<std::string>();
            double value = read<double>();
            osg::CollectOccludersVisitor *occluders = view->getCollectOccludersVisitor();
            if (name == "culling") view->setCullingMode(static_cast<int>(value));
            else if (name == "small_feature_px") view->setSmallFeatureCullingPixelSize(value);
            else if (name == "near_far")
                view->setComputeNearFarMode(static_cast<osg::CullSettings::ComputeNearFarMode>(value));
            else if (name == "occluders") occluders->setMaximumNumberOfActiveOccluders(value);
            else if (name == "nested") nested = value != 0;
            else if (name == "shadow_volume") occluders->setMinimumShadowOccluderVolume(value);
            else give_up("there is no option " + name);
        } else if (word == "object") {
            osg::ref_ptr<osg::Geode> geode = new osg::Geode;
            geode->addDrawable(read_geometry(objects.size()));
            osg::ref_ptr<osg::MatrixTransform> one = new osg::MatrixTransform;
            one->addChild(geode);
            root->addChild(one);
            objects.push_back(one);
        } else if (word == "occluder") {
            osg::MatrixTransform &one = object();
            osg::ref_ptr<osg::OccluderNode> occluder = read_occluder();
            if (nested) {
                occluder->addChild(one.getChild(0));
                one.setChild(0, occluder);
            } else {
                one.addChild(occluder);
            }
        } else if (word == "pose") {
            osg::MatrixTransform &one = object();
            one.setMatrix(read_matrix());
        } else if (word == "present") {
            osg::MatrixTransform &one = object();
            one.setNodeMask(read<int>() ? ~0u : 0u);
        } else if (word == "view") {
            int width = read<int>(), height = read<int>();
            view->setViewport(0, 0, width, height);
            view->setProjectionMatrix(read_matrix());
            view->setViewMatrix(read_matrix());
            stamp->setFrameNumber(frame++);
            view->setFrameStamp(stamp);
            view->cull();
            std::set<size_t> found;
            collect(*view->getStateGraph(), found);
            std::cout << view->getCullVisitor()->getCalculatedNearPlane() << ' '
                      << view->getCullVisitor()->getCalculatedFarPlane();
            for (size_t number : found) std::cout << ' ' << number;
            std::cout << std::endl;
        } else {
            give_up("there is no command " + word);
        }
    }
}
