/* visref_cameras.h: cameras of engines whose axes are not glTF's, for visref_recorder.h. C99 and C++. */
#ifndef VISREF_CAMERAS_H
#define VISREF_CAMERAS_H
#include <math.h>

/* The vertical field of view of a horizontal one (Unreal's), in radians; square pixels. */
static inline double visref_yfov_from_xfov(double xfov, int width, int height)
{ return 2 * atan(tan(xfov / 2) * height / width); }

/* Unreal (left-handed, Z up, centimetres): VISREF_WORLD_FROM_CAMERA, VISREF_ROW_MAJOR. `location` is the camera's in
 * cm; `forward`, `right`, `up` are the X, Y and Z axes of its rotation. As Unreal's glTF exporter and importer do it,
 * the scene's (x, y, z) is Unreal's (x, z, y) / 100. */
static inline void visref_from_unreal(double out[16], const double location[3], const double forward[3],
                                      const double right[3], const double up[3])
{
    static const int axis[3] = {0, 2, 1};
    int i;
    for (i = 0; i < 3; i++) {
        out[4 * i] = right[axis[i]];
        out[4 * i + 1] = up[axis[i]];
        out[4 * i + 2] = -forward[axis[i]];
        out[4 * i + 3] = location[axis[i]] / 100;
        out[12 + i] = 0;
    }
    out[15] = 1;
}

/* A left-handed view matrix, which looks down +Z (XMMatrixLookAtLH, glm::lookAtLH):
 * VISREF_CAMERA_FROM_WORLD, VISREF_COLUMN_MAJOR; Direct3D's row vectors in rows lie in memory like column vectors in
 * columns. The engine's world is the scene with one axis negated, as its importer did it: 0 for x, 2 for z. */
static inline void visref_from_left_handed(double out[16], const double view[16], int negated_axis)
{
    int i;
    for (i = 0; i < 16; i++) out[i] = (i % 4 == 2) != (i / 4 == negated_axis) ? -view[i] : view[i];
}

/* A right-handed view matrix with +Y down that looks down +Z (OpenCV, some Vulkan engines):
 * VISREF_CAMERA_FROM_WORLD, in the order that it has. */
static inline void visref_from_y_down(double out[16], const double view[16], int row_major)
{
    int i;
    for (i = 0; i < 16; i++) {
        int row = row_major ? i / 4 : i % 4;
        out[i] = row == 1 || row == 2 ? -view[i] : view[i];
    }
}
#endif
