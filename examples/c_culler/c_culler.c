/* A small occlusion culler in one file of C99, which visref runs as a program:
 *
 *     gcc -std=c99 -O2 -Wall -Wextra -o c_culler c_culler.c -lm
 *     visref run SCENE.glb --path PATH.json --out run \
 *         --command "./c_culler {scene} {path} {visible}"
 *
 * It draws the occluders of each view into a depth buffer and asks it about every object's box. It
 * promises to be conservative: no object that owns a sample (a pixel centre) is left out. So every
 * rounding goes to one side. Occluders cover only the samples that are certainly inside them, and
 * the depth kept there is no less than theirs. A box covers each sample that it may reach, at a
 * depth no more than that of its nearest corner.
 *
 * Blended and masked triangles never hide anything. What this program cannot place (skins, morph
 * targets, animated nodes, compressed geometry) hides nothing and is always drawn. Back faces of
 * one-sided materials hide nothing where VISREF_CULL_BACKFACES=1 says that they are culled.
 *
 * Compiled with one of the switches BROKEN_..., it goes wrong in a way in which engines do.
 */
#include <math.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(__GNUC__)
__attribute__((format(printf, 1, 2), noreturn))
#endif
static void die(const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    fputs("c_culler: ", stderr);
    vfprintf(stderr, format, arguments);
    fputc('\n', stderr);
    va_end(arguments);
    exit(1);
}

static void *allocate(size_t count, size_t size)
{
    void *memory = calloc(count ? count : 1, size);
    if (!memory)
        die("out of memory");
    return memory;
}

static char *copied(const char *text, size_t length)
{
    char *copy = allocate(length + 1, 1);
    memcpy(copy, text, length);
    return copy;
}

static unsigned char *read_file(const char *name, size_t *size)
{
    FILE *file = fopen(name, "rb");
    unsigned char *data;
    long length;
    if (!file || fseek(file, 0, SEEK_END) || (length = ftell(file)) < 0)
        die("cannot read %s", name);
    rewind(file);
    *size = (size_t)length;
    data = allocate(*size + 1, 1); /* with a zero behind it */
    if (fread(data, 1, *size, file) != *size)
        die("cannot read %s", name);
    fclose(file);
    return data;
}

/* ---- JSON ---- */

typedef enum { J_NULL, J_FALSE, J_TRUE, J_NUMBER, J_STRING, J_ARRAY, J_OBJECT } Kind;

typedef struct Json {
    Kind kind;
    double number;
    char *text; /* of a string */
    char *key;  /* of an object's member */
    struct Json *items;
    int count;
} Json;

static const char *json_at; /* where the parser stands */

static void skip_space(void)
{
    while (*json_at && strchr(" \t\r\n", *json_at))
        json_at++;
}

static unsigned hex4(void)
{
    char digits[5] = {0};
    int i;
    for (i = 0; i < 4 && json_at[i]; i++)
        digits[i] = json_at[i];
    json_at += i;
    return (unsigned)strtoul(digits, NULL, 16);
}

static char *put_utf8(char *out, unsigned code)
{
    if (code < 0x80) {
        *out++ = (char)code;
        return out;
    }
    if (code < 0x800) {
        *out++ = (char)(0xC0 | code >> 6);
    } else {
        if (code < 0x10000) {
            *out++ = (char)(0xE0 | code >> 12);
        } else {
            *out++ = (char)(0xF0 | code >> 18);
            *out++ = (char)(0x80 | (code >> 12 & 0x3F));
        }
        *out++ = (char)(0x80 | (code >> 6 & 0x3F));
    }
    *out++ = (char)(0x80 | (code & 0x3F));
    return out;
}

static char *parse_string(void)
{
    const char *end = ++json_at;
    char *text, *out;
    while (*end && *end != '"')
        end += end[0] == '\\' && end[1] ? 2 : 1;
    text = out = allocate((size_t)(end - json_at) + 1, 1);
    while (json_at < end) {
        char c = *json_at++;
        if (c != '\\') {
            *out++ = c;
            continue;
        }
        c = *json_at++;
        if (c == 'u') {
            unsigned code = hex4();
            if (code >= 0xD800 && code < 0xDC00 && json_at[0] == '\\' && json_at[1] == 'u') {
                json_at += 2;
                code = 0x10000 + ((code - 0xD800) << 10) + (hex4() - 0xDC00);
            }
            out = put_utf8(out, code);
        } else {
            static const char from[] = "bfnrt", to[] = "\b\f\n\r\t";
            const char *found = strchr(from, c);
            *out++ = found && c ? to[found - from] : c;
        }
    }
    if (*json_at != '"')
        die("JSON: a string has no end");
    json_at++;
    return text;
}

static Json parse_value(int depth);

static void parse_items(Json *into, char close, int depth)
{
    int room = 0;
    json_at++;
    skip_space();
    while (*json_at != close) {
        Json item;
        char *key = NULL;
        if (close == '}') {
            if (*json_at != '"')
                die("JSON: a member has no name");
            key = parse_string();
            skip_space();
            if (*json_at++ != ':')
                die("JSON: a colon is missing");
        }
        item = parse_value(depth + 1);
        item.key = key;
        if (into->count == room) {
            room = room ? 2 * room : 4;
            into->items = realloc(into->items, (size_t)room * sizeof(Json));
            if (!into->items)
                die("out of memory");
        }
        into->items[into->count++] = item;
        skip_space();
        if (*json_at == ',') {
            json_at++;
            skip_space();
        } else if (*json_at != close) {
            die("JSON: a comma is missing");
        }
    }
    json_at++;
}

static Json parse_value(int depth)
{
    Json value = {J_NULL, 0.0, NULL, NULL, NULL, 0};
    static const char *const words[] = {"null", "false", "true"};
    int i;
    if (depth > 200)
        die("JSON: nested too deeply");
    skip_space();
    if (*json_at == '"') {
        value.kind = J_STRING;
        value.text = parse_string();
    } else if (*json_at == '[' || *json_at == '{') {
        value.kind = *json_at == '[' ? J_ARRAY : J_OBJECT;
        parse_items(&value, *json_at == '[' ? ']' : '}', depth);
    } else if (*json_at == '-' || (*json_at >= '0' && *json_at <= '9')) {
        char *end;
        value.kind = J_NUMBER;
        value.number = strtod(json_at, &end);
        json_at = end;
    } else {
        for (i = 0; i < 3 && strncmp(json_at, words[i], strlen(words[i])); i++)
            ;
        if (i == 3)
            die("JSON: no value where one should be");
        value.kind = (Kind)i;
        json_at += strlen(words[i]);
    }
    return value;
}

static Json parse_json(const char *text)
{
    json_at = text;
    return parse_value(0);
}

/* A member of an object; NULL where there is none, or no object. */
static const Json *get(const Json *from, const char *key)
{
    int i;
    for (i = 0; from && from->kind == J_OBJECT && i < from->count; i++)
        if (!strcmp(from->items[i].key, key))
            return &from->items[i];
    return NULL;
}

static const Json *item(const Json *list, int index)
{
    return list && index >= 0 && index < list->count ? &list->items[index] : NULL;
}

static int count_of(const Json *list)
{
    return list ? list->count : 0;
}

static double number(const Json *value, double otherwise)
{
    return value && value->kind == J_NUMBER ? value->number : otherwise;
}

static int index_of(const Json *value)
{
    return (int)number(value, -1.0);
}

static const char *text_of(const Json *value)
{
    return value && value->kind == J_STRING ? value->text : "";
}

/* ---- Matrices: three rows of four, the fourth being 0 0 0 1 ---- */

typedef struct { double m[3][4]; } Affine;

static const Affine IDENTITY = {{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}};

static Affine times(const Affine *a, const Affine *b)
{
    Affine result;
    int i, j;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 4; j++)
            result.m[i][j] = a->m[i][0] * b->m[0][j] + a->m[i][1] * b->m[1][j] +
                             a->m[i][2] * b->m[2][j] + (j == 3 ? a->m[i][3] : 0.0);
    return result;
}

static void transform(const Affine *a, const double p[3], double out[3])
{
    int i;
    for (i = 0; i < 3; i++)
        out[i] = a->m[i][0] * p[0] + a->m[i][1] * p[1] + a->m[i][2] * p[2] + a->m[i][3];
}

static double determinant(const Affine *a)
{
    const double(*m)[4] = a->m;
    return m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) -
           m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
           m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
}

static Affine of_trs(const double t[3], const double r[4], const double s[3])
{
    double n = sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2] + r[3] * r[3]);
    double x = r[0] / n, y = r[1] / n, z = r[2] / n, w = r[3] / n;
    Affine a = {{{1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), t[0]},
                 {2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), t[1]},
                 {2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), t[2]}}};
    int i, j;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++)
            a.m[i][j] *= s[j];
    return a;
}

static void numbers(const Json *list, double *out, int count)
{
    int i;
    for (i = 0; list && i < count; i++)
        out[i] = number(item(list, i), 0.0);
}

/* A path's matrix: four rows of four. */
static Affine of_rows(const Json *rows)
{
    Affine a = IDENTITY;
    int i;
    if (count_of(rows) != 4 || count_of(item(rows, 0)) != 4)
        die("the path: a matrix is not four rows of four");
    for (i = 0; i < 3; i++)
        numbers(item(rows, i), a.m[i], 4);
    return a;
}

/* ---- The scene: objects, ids and names as visref gives them ---- */

enum { OCCLUDES = 1, ONE_SIDED = 2 };

typedef struct {
    double (*corners)[3]; /* three per triangle */
    unsigned char *flags; /* one per triangle */
    int triangles;
    int unknown; /* its shape cannot be told */
} Mesh;

typedef struct {
    const char *name, *path; /* as the file has it; from the root down */
    char *unique;            /* with #2, #3, ... where it repeats */
    const char *group;       /* the instanced node's name, or NULL */
    const char *group_path;
    const Mesh *mesh;
    Affine rest, world; /* where it is at rest, and in this frame */
    int hidden, absent; /* always, and in this frame */
    int unknown;
    double box[2][3]; /* in this frame, in world space */
} Object;

static Json gltf;
static const unsigned char *bin;
static size_t bin_size;
static Mesh *meshes;
static Object *objects;
static int object_count, object_room;
static char *animated; /* by node */

static uint32_t u32(const unsigned char *at)
{
    return at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16 | (uint32_t)at[3] << 24;
}

typedef struct {
    const unsigned char *start; /* NULL: zeros */
    size_t stride;
    int count, component, normalized;
} Accessor;

static size_t component_size(int component)
{
    return component == 5120 || component == 5121 ? 1 : component == 5122 || component == 5123 ? 2 : 4;
}

/* Whether the accessor's numbers, `width` per row, lie there plainly. */
static int open_accessor(int index, int width, Accessor *out)
{
    const Json *entry = item(get(&gltf, "accessors"), index);
    const Json *view = item(get(&gltf, "bufferViews"), index_of(get(entry, "bufferView")));
    const Json *normalized = get(entry, "normalized");
    size_t start, row, end;
    if (!entry)
        die("the scene: there is no accessor %d", index);
    if (get(entry, "sparse") || get(view, "extensions"))
        return 0;
    out->count = index_of(get(entry, "count"));
    out->component = index_of(get(entry, "componentType"));
    out->normalized = normalized && normalized->kind == J_TRUE;
    row = component_size(out->component) * (size_t)width;
    out->stride = (size_t)number(get(view, "byteStride"), (double)row);
    out->start = NULL;
    if (!view)
        return 1;
    start = (size_t)(number(get(view, "byteOffset"), 0.0) + number(get(entry, "byteOffset"), 0.0));
    end = start + out->stride * (size_t)(out->count > 0 ? out->count - 1 : 0) + row;
    if (index_of(get(view, "buffer")) != 0 || !bin || (out->count > 0 && end > bin_size))
        die("the scene: accessor %d is not in the file's own buffer", index);
    out->start = bin + start;
    return 1;
}

static double component(const Accessor *of, int row, int column)
{
    static const double most[] = {127.0, 255.0, 32767.0, 65535.0};
    const unsigned char *at;
    double value;
    if (!of->start)
        return 0.0;
    at = of->start + of->stride * (size_t)row + component_size(of->component) * (size_t)column;
    if (of->component == 5126) {
        uint32_t bits = u32(at);
        float single;
        memcpy(&single, &bits, 4);
        return single;
    }
    switch (of->component) {
    case 5120: value = (int8_t)at[0]; break;
    case 5121: value = at[0]; break;
    case 5122: value = (int16_t)(at[0] | at[1] << 8); break;
    case 5123: value = at[0] | at[1] << 8; break;
    default: return u32(at);
    }
    if (of->normalized)
        value = fmax(value / most[of->component - 5120], -1.0);
    return value;
}

static unsigned char flags_of(const Json *primitive)
{
    const Json *material = item(get(&gltf, "materials"), index_of(get(primitive, "material")));
    const Json *extensions = get(material, "extensions");
    const Json *two = get(material, "doubleSided");
    const char *mode = text_of(get(material, "alphaMode"));
    int glass = number(get(get(extensions, "KHR_materials_transmission"), "transmissionFactor"), 0.0) > 0.0;
    unsigned char flags = two && two->kind == J_TRUE ? 0 : ONE_SIDED;
#ifdef BROKEN_BLEND
    glass = 0;
    if (!strcmp(mode, "BLEND"))
        return flags | OCCLUDES;
#endif
#ifdef BROKEN_MASK
    if (!strcmp(mode, "MASK"))
        return flags | OCCLUDES;
#endif
    return !glass && strcmp(mode, "BLEND") && strcmp(mode, "MASK") ? flags | OCCLUDES : flags;
}

static void add_primitive(Mesh *mesh, const Json *primitive)
{
    int mode = (int)number(get(primitive, "mode"), 4.0), count, triangles, i, k;
    int position = index_of(get(get(primitive, "attributes"), "POSITION"));
    const Json *indices = get(primitive, "indices");
    Accessor points, order = {NULL, 0, 0, 0, 0};
    if (mode < 4 || position < 0)
        return; /* points and lines own no sample */
    if (get(primitive, "targets") || get(get(primitive, "extensions"), "KHR_draco_mesh_compression") ||
        !open_accessor(position, 3, &points) ||
        (indices && !open_accessor(index_of(indices), 1, &order))) {
        mesh->unknown = 1;
        return;
    }
    count = indices ? order.count : points.count;
    triangles = mode == 4 ? count / 3 : count > 2 ? count - 2 : 0;
    mesh->corners = realloc(mesh->corners, (size_t)(mesh->triangles + triangles + 1) * 3 * sizeof *mesh->corners);
    mesh->flags = realloc(mesh->flags, (size_t)(mesh->triangles + triangles + 1));
    if (!mesh->corners || !mesh->flags)
        die("out of memory");
    for (i = 0; i < triangles; i++, mesh->triangles++) {
        int of[3];
        of[0] = mode == 4 ? 3 * i : mode == 5 ? i : 0;
        of[1] = mode == 4 ? 3 * i + 1 : mode == 5 ? i + 1 + i % 2 : i + 1;
        of[2] = mode == 4 ? 3 * i + 2 : mode == 5 ? i + 2 - i % 2 : i + 2;
        for (k = 0; k < 3; k++) {
            double *corner = mesh->corners[3 * mesh->triangles + k];
            double vertex = indices ? component(&order, of[k], 0) : of[k];
            int axis;
            if (!(vertex >= 0.0 && vertex < points.count))
                die("the scene: a triangle names vertex %.0f of %d", vertex, points.count);
            for (axis = 0; axis < 3; axis++)
                corner[axis] = component(&points, (int)vertex, axis);
        }
        mesh->flags[mesh->triangles] = flags_of(primitive);
    }
}

static Affine local_of(const Json *node)
{
    double t[3] = {0, 0, 0}, r[4] = {0, 0, 0, 1}, s[3] = {1, 1, 1}, columns[16];
    const Json *matrix = get(node, "matrix");
    Affine a;
    int i, j;
    if (matrix) {
        numbers(matrix, columns, 16);
        for (i = 0; i < 3; i++)
            for (j = 0; j < 4; j++)
                a.m[i][j] = columns[4 * j + i];
        return a;
    }
    numbers(get(node, "translation"), t, 3);
    numbers(get(node, "rotation"), r, 4);
    numbers(get(node, "scale"), s, 3);
    return of_trs(t, r, s);
}

static void add_object(const Object *object)
{
    if (object_count == object_room) {
        object_room = object_room ? 2 * object_room : 64;
        objects = realloc(objects, (size_t)object_room * sizeof *objects);
        if (!objects)
            die("out of memory");
    }
    objects[object_count++] = *object;
}

/* One object for each instance of an instanced node. */
static void add_instances(Object *object, const Json *attributes)
{
    static const char *const names[] = {"TRANSLATION", "ROTATION", "SCALE"};
    static const int widths[] = {3, 4, 3};
    Accessor of[3];
    int there[3], count = 0, i, k, column;
    Affine node = object->rest, instance;
    for (k = 0; k < 3; k++) {
        there[k] = get(attributes, names[k]) != NULL;
        if (there[k] && !open_accessor(index_of(get(attributes, names[k])), widths[k], &of[k]))
            die("the scene: instances that lie in compressed or sparse data");
        if (there[k])
            count = of[k].count;
    }
    for (i = 0; i < count; i++) {
        double trs[3][4] = {{0, 0, 0, 0}, {0, 0, 0, 1}, {1, 1, 1, 0}};
        for (k = 0; k < 3; k++)
            for (column = 0; there[k] && column < widths[k]; column++)
                trs[k][column] = component(&of[k], i, column);
        instance = of_trs(trs[0], trs[1], trs[2]);
        object->rest = times(&node, &instance);
        add_object(object);
    }
}

static const char *below(const char *path, const char *name)
{
    size_t length = strlen(path) + strlen(name) + 2;
    char *joined;
    if (!*name || !*path)
        return *name ? name : path;
    joined = allocate(length, 1);
    sprintf(joined, "%s/%s", path, name);
    return joined;
}

/* A node and what is below it, depth first: the order of the ids. */
static void add_node(int index, const Affine *above, const char *nearest, const char *path, int unknown,
                     int hidden, int depth)
{
    const Json *node = item(get(&gltf, "nodes"), index);
    const Json *extensions = get(node, "extensions");
    const Json *visible = get(get(extensions, "KHR_node_visibility"), "visible");
    const Json *children = get(node, "children");
    const char *name = text_of(get(node, "name"));
    int mesh = index_of(get(node, "mesh")), i;
    Affine local, world;
    if (!node || depth > 10000)
        die("the scene: its nodes are no tree");
    local = local_of(node);
    world = times(above, &local);
    unknown |= animated[index];
    hidden |= visible && visible->kind == J_FALSE;
    if (mesh >= 0) {
        const Json *instancing = get(get(extensions, "EXT_mesh_gpu_instancing"), "attributes");
        const char *own = *name ? name : text_of(get(item(get(&gltf, "meshes"), mesh), "name"));
        Object object;
        memset(&object, 0, sizeof object);
        object.name = *own ? own : *nearest ? nearest : "object";
        object.path = below(path, own);
        object.mesh = &meshes[mesh];
        object.rest = world;
        object.hidden = hidden;
        object.unknown = unknown || get(node, "skin") || meshes[mesh].unknown;
        if (instancing) {
            object.group = object.name;
            object.group_path = object.path;
            add_instances(&object, instancing);
        } else {
            add_object(&object);
        }
    }
    for (i = 0; i < count_of(children); i++)
        add_node(index_of(item(children, i)), &world, *name ? name : nearest, below(path, name), unknown,
                 hidden, depth + 1);
}

static int by_name(const void *a, const void *b)
{
    const Object *x = *(Object *const *)a, *y = *(Object *const *)b;
    int order = strcmp(x->name, y->name);
    return order ? order : x < y ? -1 : x > y;
}

static int name_is(const void *key, const void *element)
{
    return strcmp(key, (*(Object *const *)element)->name);
}

/* The second of several objects of a name is NAME#2, the third NAME#3, skipping names that are. */
static void make_names_unique(void)
{
    Object **sorted = allocate((size_t)object_count, sizeof *sorted);
    int i, mark = 2;
    for (i = 0; i < object_count; i++)
        sorted[i] = &objects[i];
    qsort(sorted, (size_t)object_count, sizeof *sorted, by_name);
    for (i = 0; i < object_count; i++) {
        const char *name = sorted[i]->name;
        char *unique = allocate(strlen(name) + 16, 1);
        strcpy(unique, name);
        if (!i || strcmp(name, sorted[i - 1]->name))
            mark = 2;
        else
            do
                sprintf(unique, "%s#%d", name, mark++);
            while (bsearch(unique, sorted, (size_t)object_count, sizeof *sorted, name_is));
        sorted[i]->unique = unique;
    }
    free(sorted);
}

static void read_scene(const char *file)
{
    size_t size, at = 12;
    const unsigned char *data = read_file(file, &size);
    const Json *list, *roots;
    int i, k;
    if (size < 20 || memcmp(data, "glTF", 4) || u32(data + 4) != 2)
        die("%s is no GLB file of version 2", file);
    while (at + 8 <= size) {
        size_t length = u32(data + at);
        if (length > size - at - 8)
            die("%s ends within a chunk", file);
        if (!memcmp(data + at + 4, "JSON", 4))
            gltf = parse_json(copied((const char *)data + at + 8, length));
        else if (!memcmp(data + at + 4, "BIN", 4)) {
            bin = data + at + 8;
            bin_size = length;
        }
        at += 8 + length;
    }
    list = get(&gltf, "extensionsUsed");
    for (i = 0; i < count_of(list); i++)
        if (!strcmp(text_of(item(list, i)), "MSFT_lod"))
            die("the scene: levels of detail (MSFT_lod) are not known here");
    list = get(&gltf, "nodes");
    animated = allocate((size_t)count_of(list), 1);
    list = get(&gltf, "animations");
    for (i = 0; i < count_of(list); i++) {
        const Json *channels = get(item(list, i), "channels");
        for (k = 0; k < count_of(channels); k++) {
            int node = index_of(get(get(item(channels, k), "target"), "node"));
            int nodes = count_of(get(&gltf, "nodes"));
            if (node >= 0 && node < nodes)
                animated[node] = 1;
            else /* it may be anything */
                memset(animated, 1, (size_t)nodes);
        }
    }
    list = get(&gltf, "meshes");
    meshes = allocate((size_t)count_of(list), sizeof *meshes);
    for (i = 0; i < count_of(list); i++) {
        const Json *primitives = get(item(list, i), "primitives");
        for (k = 0; k < count_of(primitives); k++)
            add_primitive(&meshes[i], item(primitives, k));
    }
    list = get(&gltf, "scenes");
    roots = get(item(list, (int)number(get(&gltf, "scene"), 0.0)), "nodes");
    for (i = 0; i < count_of(roots); i++)
        add_node(index_of(item(roots, i)), &IDENTITY, "", "", 0, 0, 0);
    make_names_unique();
}

/* ---- What a frame says of objects ---- */

/* The objects that a name stands for, one or a group's: their ids, and how many. */
static int meant(const char *name, int *ids, int *is_group)
{
    const char *plain = strncmp(name, "group:", 6) ? name : name + 6;
    int i, count = 0;
    *is_group = 0;
    for (i = 0; i < object_count && plain == name; i++) {
        const Object *o = &objects[i];
        const char *from_root = *name == '/' ? name + 1 : name;
        int own = !strcmp(o->name, name) && !(o->group && !strcmp(o->group, name));
        if (own || (!strcmp(o->path, from_root) && !(o->group && !strcmp(o->group_path, from_root))))
            ids[count++] = i;
    }
    for (i = 0; i < object_count && !count; i++)
        if (plain == name && strcmp(objects[i].unique, objects[i].name) && !strcmp(objects[i].unique, name))
            ids[count++] = i;
    if (count > 1)
        die("the path: '%s' may be several objects", name);
    if (count)
        return 1;
    for (i = 0; i < object_count; i++)
        if (objects[i].group && (!strcmp(objects[i].group, plain) || !strcmp(objects[i].group_path, plain)))
            ids[count++] = i;
    if (!count)
        die("the path: the scene has no object '%s'", name);
    *is_group = 1;
    return count;
}

static void pose(const Json *frame)
{
    const Json *moved = get(frame, "world_from_object"), *absent = get(frame, "absent");
    const Json *levels = get(frame, "levels");
    int *ids = allocate((size_t)object_count, sizeof *ids);
    int i, k, axis, count, is_group;
    for (i = 0; i < count_of(levels); i++)
        if (number(item(levels, i), 0.0) != 0.0)
            die("the path: levels of detail are not known here");
    for (i = 0; i < object_count; i++) {
        objects[i].world = objects[i].rest;
        objects[i].absent = objects[i].hidden;
    }
    for (i = 0; i < count_of(moved); i++) {
        Affine matrix = of_rows(item(moved, i));
        count = meant(item(moved, i)->key, ids, &is_group);
        for (k = 0; k < count; k++)
            objects[ids[k]].world = is_group ? times(&matrix, &objects[ids[k]].rest) : matrix;
    }
    for (i = 0; i < count_of(absent); i++) {
        count = meant(text_of(item(absent, i)), ids, &is_group);
        for (k = 0; k < count; k++)
            objects[ids[k]].absent = 1;
    }
    free(ids);
    for (i = 0; i < object_count; i++) {
        Object *o = &objects[i];
        const Affine *world = &o->world;
#ifdef BROKEN_POSES
        world = &o->rest;
#endif
        for (axis = 0; axis < 3; axis++) {
            o->box[0][axis] = INFINITY;
            o->box[1][axis] = -INFINITY;
        }
        for (k = 0; k < 3 * o->mesh->triangles; k++) {
            double p[3];
            transform(world, o->mesh->corners[k], p);
            for (axis = 0; axis < 3; axis++) {
                o->box[0][axis] = fmin(o->box[0][axis], p[axis]);
                o->box[1][axis] = fmax(o->box[1][axis], p[axis]);
            }
        }
    }
}

/* ---- A view ----
 *
 * A sample at pixel (x, y) has the ray e + t (F + a R + b U), or e + a R + b U + t F in parallel,
 * with a = 2 (x + shift) + 1 - width, b = height - 2 (y + shift) - 1; t is its view depth. Points
 * are held as q = (coordinates along R and U, depth): such a ray is t (a, b, 1), or (a, b, t).
 */
typedef struct {
    const char *name;
    int width, height, parallel;
    double near, far, shift[2];
    double e[3], F[3], R[3], U[3];
    double step;          /* of R and U: half a pixel */
    double inverse[3][3]; /* q from world less e */
    int has_plane;
    double plane[4]; /* nothing counts where it is negative */
} View;

static View read_view(const Json *const levels[3], const char *name)
{
    static const char *const fields[] = {"width",  "height",     "near",       "yfov",
                                         "ymag",   "shift_x_px", "shift_y_px", "far"};
    const Json *found[8] = {NULL}, *pose_rows = NULL, *plane = NULL;
    Affine world, basis;
    View v;
    double tall, d;
    int level, i, j;
    memset(&v, 0, sizeof v);
    v.name = name;
    for (level = 0; level < 3; level++) {
        const Json *yfov = get(levels[level], "yfov"), *ymag = get(levels[level], "ymag");
        for (i = 0; i < 8; i++)
            if (get(levels[level], fields[i]))
                found[i] = get(levels[level], fields[i]);
        if (yfov && !ymag)
            found[4] = NULL; /* one kind of projection overrides the other */
        if (ymag && !yfov)
            found[3] = NULL;
        if (get(levels[level], "world_from_camera"))
            pose_rows = get(levels[level], "world_from_camera");
        if (get(levels[level], "clip_plane"))
            plane = get(levels[level], "clip_plane");
    }
    if (!pose_rows)
        die("the path: a view has no world_from_camera");
    world = of_rows(pose_rows);
    v.width = index_of(found[0]);
    v.height = index_of(found[1]);
    v.near = number(found[2], NAN);
    v.far = number(found[7], INFINITY);
    v.parallel = found[4] && found[4]->kind == J_NUMBER;
    tall = v.parallel ? found[4]->number : tan(number(found[3], NAN) / 2.0);
    if (v.width < 1 || v.height < 1 || !(tall > 0.0) || isnan(v.near))
        die("the path: a view has no width, height, near, yfov or ymag");
    v.step = tall / v.height;
    v.shift[0] = number(found[5], 0.0);
    v.shift[1] = number(found[6], 0.0);
    for (i = 0; i < 3; i++) {
        v.e[i] = world.m[i][3];
        v.F[i] = -world.m[i][2];
        v.R[i] = world.m[i][0] * v.step;
        v.U[i] = world.m[i][1] * v.step;
        basis.m[i][0] = v.R[i];
        basis.m[i][1] = v.U[i];
        basis.m[i][2] = v.F[i];
    }
    d = determinant(&basis);
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) {
            const double(*m)[4] = (const double(*)[4])basis.m;
            int a = (i + 1) % 3, b = (i + 2) % 3, p = (j + 1) % 3, q = (j + 2) % 3;
            v.inverse[i][j] = (m[p][a] * m[q][b] - m[p][b] * m[q][a]) / d;
        }
    v.has_plane = plane && plane->kind == J_ARRAY;
    numbers(plane, v.plane, 4);
    return v;
}

static void to_view(const View *v, const double p[3], double q[3])
{
    int i;
    for (i = 0; i < 3; i++)
        q[i] = v->inverse[i][0] * (p[0] - v->e[0]) + v->inverse[i][1] * (p[1] - v->e[1]) +
               v->inverse[i][2] * (p[2] - v->e[2]);
}

typedef struct { double low[2], high[2]; } Range; /* of a and b */

static void widen(Range *range, double a, double b)
{
    range->low[0] = fmin(range->low[0], a);
    range->low[1] = fmin(range->low[1], b);
    range->high[0] = fmax(range->high[0], a);
    range->high[1] = fmax(range->high[1], b);
}

/* Where a convex thing of n points lies in the image, cut off at the near plane. Any two points may
 * be an edge: what lies between them is inside. */
static Range seen_range(const View *v, double (*q)[3], int n)
{
    Range range = {{INFINITY, INFINITY}, {-INFINITY, -INFINITY}};
    double z = v->near * (1.0 - 1e-9);
    int i, j;
    for (i = 0; i < n; i++) {
        if (v->parallel) {
            widen(&range, q[i][0], q[i][1]);
            continue;
        }
#ifdef BROKEN_NEAR
        widen(&range, q[i][0] / q[i][2], q[i][1] / q[i][2]);
        continue;
#endif
        if (q[i][2] >= z) {
            widen(&range, q[i][0] / q[i][2], q[i][1] / q[i][2]);
            continue;
        }
        for (j = 0; j < n; j++)
            if (q[j][2] > z) {
                double share = (z - q[i][2]) / (q[j][2] - q[i][2]);
                widen(&range, (q[i][0] + share * (q[j][0] - q[i][0])) / z,
                      (q[i][1] + share * (q[j][1] - q[i][1])) / z);
            }
    }
    return range;
}

typedef struct { int left, right, top, bottom; } Pixels; /* inclusive */

static int clamped(double value, int low, int high)
{
    return value < low ? low : value > high ? high : (int)value;
}

/* The samples within a range, and those that rounding may have put outside; `more` pixels around. */
static Pixels pixels_of(const View *v, const Range *range, double more)
{
    Pixels p = {0, -1, 0, -1};
    double sx = v->shift[0], sy = v->shift[1];
    double left = (range->low[0] - 1.0 + v->width) / 2.0 - sx;
    double right = (range->high[0] - 1.0 + v->width) / 2.0 - sx;
    double top = (v->height - 1.0 - range->high[1]) / 2.0 - sy;
    double bottom = (v->height - 1.0 - range->low[1]) / 2.0 - sy;
    /* Far more than float64 rounds, and far less than a pixel. */
    more += 1e-6;
    if (!(range->low[0] <= range->high[0]))
        return p;
    p.left = clamped(ceil(left - more), 0, v->width);
    p.right = clamped(floor(right + more), -1, v->width - 1);
    p.top = clamped(ceil(top - more), 0, v->height);
    p.bottom = clamped(floor(bottom + more), -1, v->height - 1);
    return p;
}

static double dot(const double *a, const double *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double *a, const double *b, double *out)
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* Lower the depth of the samples that a triangle certainly covers to its greatest depth there.
 * `error`: how far each vertex may be from where it is said to be, along any axis of the world.
 * `facing`: 1 or -1 where only a counter-clockwise or a clockwise triangle counts, 0 for both. */
static void occlude(const View *v, double (*world)[3], double error, int facing, double *depth)
{
    double q[3][3], c[3][3], margin[3], n[3], slip[3], side[2][3], a0, b0, half[2], orientation;
    double turned = 1.8 * error; /* along the view's axes: more than the root of 3 */
    Range range;
    Pixels p;
    int i, k, x, y;
    for (i = 0; i < 3; i++)
        to_view(v, world[i], q[i]);
    range = seen_range(v, q, 3);
    p = pixels_of(v, &range, 1.0);
    if (p.left > p.right || p.top > p.bottom)
        return;
    /* About the middle of what is seen of it, numbers are small, and so are their errors. */
    a0 = p.left + p.right + 2.0 * v->shift[0] + 1.0 - v->width;
    b0 = v->height - (p.top + p.bottom + 2.0 * v->shift[1]) - 1.0;
    half[0] = p.right - p.left + 1.0;
    half[1] = p.bottom - p.top + 1.0;
    slip[0] = turned / v->step + (v->parallel ? 0.0 : fabs(a0) * turned);
    slip[1] = turned / v->step + (v->parallel ? 0.0 : fabs(b0) * turned);
    slip[2] = turned;
    for (i = 0; i < 3; i++) {
        q[i][0] -= a0 * (v->parallel ? 1.0 : q[i][2]);
        q[i][1] -= b0 * (v->parallel ? 1.0 : q[i][2]);
    }
    for (i = 0; i < 2; i++)
        for (k = 0; k < 3; k++)
            side[i][k] = q[i + 1][k] - q[0][k];
    cross(side[0], side[1], n);
    /* Edge functions: c . (a, b, 1) has the orientation's sign inside. */
    for (i = 0; i < 3; i++) {
        double r[2][3], wrong[3], s2 = v->parallel ? 0.0 : slip[2];
        for (k = 0; k < 2; k++) {
            memcpy(r[k], q[(i + 1 + k) % 3], sizeof r[k]);
            if (v->parallel)
                r[k][2] = 1.0;
        }
        cross(r[0], r[1], c[i]);
        for (k = 0; k < 3; k++) {
            int l = (k + 1) % 3, m = (k + 2) % 3;
            double sl = l == 2 ? s2 : slip[l], sm = m == 2 ? s2 : slip[m];
            wrong[k] = sl * (fabs(r[0][m]) + fabs(r[1][m]) + 2.0 * sm) +
                       sm * (fabs(r[0][l]) + fabs(r[1][l]));
            /* And what float64 rounds. */
            wrong[k] += 1e-14 * (fabs(r[0][l] * r[1][m]) + fabs(r[0][m] * r[1][l]));
        }
        margin[i] = wrong[0] * half[0] + wrong[1] * half[1] + wrong[2] +
                    1e-14 * (fabs(c[i][0]) * half[0] + fabs(c[i][1]) * half[1] + fabs(c[i][2]));
    }
    orientation = v->parallel ? n[2] : dot(n, q[0]);
    orientation = orientation > 0.0 ? 1.0 : -1.0;
#ifndef BROKEN_BACKFACE
    if (facing && facing * orientation < 0.0)
        return;
#endif
    (void)facing;
    for (y = p.top; y <= p.bottom; y++)
        for (x = p.left; x <= p.right; x++) {
            double a = 2.0 * x - (p.left + p.right), b = p.top + p.bottom - 2.0 * y, d, t, off;
            double *at = &depth[(size_t)y * (size_t)v->width + (size_t)x];
            for (i = 0; i < 3; i++)
                if (!(orientation * (c[i][0] * a + c[i][1] * b + c[i][2]) > margin[i]))
                    break;
            if (i < 3)
                continue;
            d = v->parallel ? n[2] : n[0] * a + n[1] * b + n[2];
            t = v->parallel ? (dot(n, q[0]) - n[0] * a - n[1] * b) / n[2] : dot(n, q[0]) / d;
            /* The plane shifts by no more than its vertices do. */
            off = (fabs(n[0]) * slip[0] + fabs(n[1]) * slip[1] + fabs(n[2]) * slip[2]) / fabs(d);
            off += 1e-13 * (fabs(n[0] * q[0][0]) + fabs(n[1] * q[0][1]) + fabs(n[2] * q[0][2])) / fabs(d);
            off += 1e-12 * fabs(t);
#ifndef BROKEN_NEAR_OCCLUDERS
            if (!(t - off > v->near))
                continue; /* cut off */
#endif
#ifndef BROKEN_CLIP_PLANE
            if (v->has_plane) {
                double value = v->plane[3], unsure = 1e-12 * fabs(v->plane[3]);
                for (k = 0; k < 3; k++) {
                    double aside = (a + a0) * v->R[k] + (b + b0) * v->U[k];
                    double along = v->parallel ? v->F[k] : v->F[k] + aside; /* per unit of t */
                    double from = v->parallel ? v->e[k] + aside : v->e[k];
                    value += v->plane[k] * (from + t * along);
                    unsure += fabs(v->plane[k]) * (1e-12 * (fabs(from) + fabs(t * along)) + off * fabs(along));
                }
                if (!(value > unsure))
                    continue;
            }
#endif
            if (t + off < *at)
                *at = t + off;
        }
}

/* Whether a sample that the box reaches may show what is in it. `box`: grown by all errors. */
static int box_shows(const View *v, double (*box)[3], const double *depth)
{
    double q[8][3], nearest = INFINITY, farthest = -INFINITY, before = -INFINITY, p[3];
    Range range;
    Pixels pixels;
    int i, k, x, y;
    for (i = 0; i < 8; i++) {
        double value = v->plane[3], sum = fabs(v->plane[3]);
        for (k = 0; k < 3; k++) {
            p[k] = box[i >> k & 1][k];
            value += v->plane[k] * p[k];
            sum += fabs(v->plane[k] * p[k]);
        }
        before = fmax(before, value + 1e-12 * sum);
        to_view(v, p, q[i]);
        nearest = fmin(nearest, q[i][2]);
        farthest = fmax(farthest, q[i][2]);
    }
#ifdef BROKEN_NEAREST
    nearest = (nearest + farthest) / 2.0;
#endif
#ifdef BROKEN_DISTANCE
    for (nearest = INFINITY, i = 0; i < 8; i++) {
        double r = v->step * q[i][0], u = v->step * q[i][1];
        nearest = fmin(nearest, sqrt(r * r + u * u + q[i][2] * q[i][2]));
    }
#endif
#ifdef BROKEN_ORTHOGRAPHIC
    {
        View perspective = *v;
        perspective.parallel = 0;
        perspective.near = fmax(v->near, 0.01);
        for (i = 0; v->parallel && i < 8; i++)
            for (k = 0; k < 2; k++) /* as if ymag were the height at depth 10 */
                q[i][k] *= 10.0;
        range = seen_range(&perspective, q, 8);
    }
#else
    range = seen_range(v, q, 8);
#endif
    nearest = fmax(nearest, v->near);
    nearest -= 1e-12 * fabs(nearest);
    farthest += 1e-12 * fabs(farthest);
    if (farthest < v->near || nearest > v->far || (v->has_plane && before < 0.0))
        return 0;
#ifdef BROKEN_LENS_SHIFT
    {
        View straight = *v;
        straight.shift[0] = straight.shift[1] = 0.0;
        pixels = pixels_of(&straight, &range, 0.0);
    }
#elif defined BROKEN_ROUNDING
    pixels = pixels_of(v, &range, -0.5);
#else
    pixels = pixels_of(v, &range, 0.0);
#endif
    for (y = pixels.top; y <= pixels.bottom; y++)
        for (x = pixels.left; x <= pixels.right; x++) {
#ifdef BROKEN_CORNERS
            if ((x != pixels.left && x != pixels.right) || (y != pixels.top && y != pixels.bottom))
                continue;
#endif
            if (depth[(size_t)y * (size_t)v->width + (size_t)x] >= nearest)
                return 1;
        }
    return 0;
}

/* ---- How exact the numbers are ---- */

/* A renderer, and visref, hold vertices in float32, relative to zero or, where the scene lies far
 * out, to a point near its middle; so each may be off by that rounding. */
static double middle[3], spread;

static void measure_scene(void)
{
    double box[2][3] = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    int i, k;
    for (i = 0; i < object_count; i++)
        for (k = 0; k < 3; k++) {
            box[0][k] = fmin(box[0][k], objects[i].box[0][k]);
            box[1][k] = fmax(box[1][k], objects[i].box[1][k]);
        }
    spread = 0.0;
    for (k = 0; k < 3; k++)
        spread = fmax(spread, box[1][k] - box[0][k]);
    for (k = 0; k < 3; k++) {
        middle[k] = (box[0][k] + box[1][k]) / 2.0;
        if (!(fabs(middle[k]) > 8.0 * spread))
            middle[k] = 0.0;
    }
}

/* How far a vertex of the object may be from where it is said to be, along any axis. */
static double error_of(const Object *o, const View *v)
{
    double single = 0.0, twofold = 0.0;
    int k, side;
    for (k = 0; k < 3; k++)
        for (side = 0; side < 2; side++) {
            double relative = fabs(o->box[side][k] - middle[k]) + (middle[k] != 0.0 ? spread : 0.0);
            single = fmax(single, middle[k] != 0.0 ? 4.0 * relative : relative);
            twofold = fmax(twofold, fabs(o->box[side][k]) + fabs(v->e[k]));
        }
    return ldexp(single, -23) + 1e-14 * twofold; /* float32 rounds by 2^-24 at most */
}

/* ---- Frames ---- */

static int culls_backfaces;

static void draw_occluders(const View *v, double *depth)
{
    size_t count = (size_t)v->width * (size_t)v->height, at;
    int i, k, c;
    for (at = 0; at < count; at++)
        depth[at] = INFINITY;
    for (i = 0; i < object_count; i++) {
        const Object *o = &objects[i];
        double error = error_of(o, v);
        int front = determinant(&o->world) < 0.0 ? -1 : 1;
        int there = !o->absent;
#ifdef BROKEN_ABSENT
        there = 1;
#endif
        if (!there || o->unknown)
            continue;
        for (k = 0; k < o->mesh->triangles; k++) {
            int one_sided = culls_backfaces && (o->mesh->flags[k] & ONE_SIDED);
            double world[3][3];
            if (!(o->mesh->flags[k] & OCCLUDES))
                continue;
            for (c = 0; c < 3; c++)
                transform(&o->world, o->mesh->corners[3 * k + c], world[c]);
            occlude(v, world, error, one_sided ? front : 0, depth);
        }
    }
}

static int shows(const Object *o, const View *v, const double *depth)
{
    double error = error_of(o, v), box[2][3];
    int k;
    if (o->absent)
        return 0;
    if (o->unknown)
        return 1;
    if (!o->mesh->triangles)
        return 0;
    for (k = 0; k < 3; k++) {
        box[0][k] = o->box[0][k] - error;
        box[1][k] = o->box[1][k] + error;
    }
    return box_shows(v, box, depth);
}

static void write_string(FILE *out, const char *text)
{
    fputc('"', out);
    for (; *text; text++)
        if ((unsigned char)*text < 0x20)
            fprintf(out, "\\u%04x", (unsigned)*text);
        else
            fprintf(out, *text == '"' || *text == '\\' ? "\\%c" : "%c", *text);
    fputc('"', out);
}

static void write_visible(FILE *out, const View *v, const double *depth)
{
    const char *comma = "";
    int i;
    fputc('[', out);
    for (i = 0; i < object_count; i++)
        if (shows(&objects[i], v, depth)) {
            fprintf(out, "%s%d", comma, i);
            comma = ", ";
        }
    fputc(']', out);
}

static void cull_frame(FILE *out, const Json *top, const Json *frame, int index)
{
    const Json *views = get(frame, "views"), *levels[3];
    int count = views ? count_of(views) : 1, i;
    double *depth = NULL;
    levels[0] = top;
    levels[1] = frame;
    pose(frame);
    if (index == 0)
        measure_scene();
    fprintf(out, "{\"frame\": %d, \"visible\": %s", index, views ? "{" : "");
    for (i = 0; i < count; i++) {
        View v;
        levels[2] = views ? item(views, i) : NULL;
        v = read_view(levels, views ? item(views, i)->key : "");
#ifdef BROKEN_VIEWS
        if (depth == NULL)
#endif
        {
            free(depth);
            depth = allocate((size_t)v.width * (size_t)v.height, sizeof *depth);
            draw_occluders(&v, depth);
        }
        if (views) {
            fputs(i ? ", " : "", out);
            write_string(out, v.name);
            fputs(": ", out);
        }
        write_visible(out, &v, depth);
    }
    free(depth);
    fputs(views ? "}}\n" : "}\n", out);
}

int main(int count, char **words)
{
    const char *culls = getenv("VISREF_CULL_BACKFACES");
    const Json *frames;
    size_t size;
    FILE *out;
    Json path;
    int i;
    if (count != 4)
        die("usage: c_culler SCENE.glb PATH.json VISIBLE.jsonl");
    culls_backfaces = culls && !strcmp(culls, "1");
    read_scene(words[1]);
    path = parse_json((const char *)read_file(words[2], &size));
    frames = get(&path, "frames");
    out = fopen(words[3], "w");
    if (strcmp(text_of(get(&path, "format")), "visref-path") || !frames)
        die("%s is no camera path", words[2]);
    if (!out)
        die("cannot write %s", words[3]);
    for (i = 0; i < frames->count; i++)
        cull_frame(out, &path, item(frames, i), i);
    if (fclose(out))
        die("cannot write %s", words[3]);
    return 0;
}
