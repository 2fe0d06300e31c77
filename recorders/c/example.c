/* An engine in fifty lines: it moves past three boxes, culls them by their spheres against the frustum, and
 * records what it draws. Build: cc example.c -lm. Run: ./a.out recording.jsonl [NAME], which forgets to draw NAME. */
#define VISREF_RECORDER_IMPLEMENTATION
#include "visref_recorder.h"
#include <stdio.h>
#include <string.h>

static const int WIDTH = 64, HEIGHT = 48, FRAMES = 4;
static const double YFOV = 0.9;
static const struct { const char *name; double centre[3], radius; } boxes[] = {
    {"front", {0, 0, 0}, 1.75}, {"behind", {0, 0, -5}, 1.75}, {"beside", {3, 0, 0}, 1.75}};

/* Whether a sphere may show: not wholly behind the camera or beyond a side of its frustum. */
static int in_view(const double centre[3], double radius, const double eye[3]) {
    double x = fabs(centre[0] - eye[0]), y = fabs(centre[1] - eye[1]), depth = eye[2] - centre[2];
    double up = tan(YFOV / 2), right = up * WIDTH / HEIGHT;
    return depth > -radius && x - right * depth < radius * sqrt(1 + right * right) &&
           y - up * depth < radius * sqrt(1 + up * up);
}

int main(int count, char **arguments) {
    const char *forgotten = count > 2 ? arguments[2] : "";
    char problem[256];
    int frame;
    size_t i;
    visref_recorder *r = visref_open(count > 1 ? arguments[1] : "recording.jsonl", WIDTH, HEIGHT);
    visref_field(r, NULL, "near", 0.1);
    visref_field(r, NULL, "far", HUGE_VAL);
    visref_field(r, NULL, "yfov", YFOV);
    for (frame = 0; frame < FRAMES; frame++) {
        const double eye[3] = {1.0 * frame, 0.5, 10 - 2.0 * frame};
        /* As OpenGL has it: a view matrix, column by column. */
        const double view[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, -eye[0], -eye[1], -eye[2], 1};
        visref_begin_frame(r, frame);
        visref_camera(r, NULL, VISREF_CAMERA_FROM_WORLD, VISREF_COLUMN_MAJOR, view);
        for (i = 0; i < sizeof boxes / sizeof *boxes; i++)
            if (in_view(boxes[i].centre, boxes[i].radius, eye) && strcmp(boxes[i].name, forgotten) != 0)
                visref_visible_name(r, NULL, boxes[i].name);
        visref_end_frame(r);
    }
    if (visref_close(r, problem, sizeof problem)) {
        fprintf(stderr, "%s\n", problem);
        return 1;
    }
    return 0;
}
