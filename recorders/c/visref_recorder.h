/* visref_recorder.h: writes what an engine saw and drew as a visref recording, a line per frame, for
 * `visref check SCENE --recording FILE`. C99 and C++11. One source file of yours says
 *     #define VISREF_RECORDER_IMPLEMENTATION
 * before it includes this; the others only include it. For the compiler, or before every include:
 *     VISREF_RECORDER_OFF          every call becomes nothing;
 *     VISREF_RECORDER_THREAD_SAFE  several threads may fill one frame (pthreads, or Windows' locks);
 *     VISREF_RECORDER_BUFFER       bytes of the file's buffer (65536).
 * Within a frame the calls come in any order. What first goes wrong (a number that is not finite, a name that
 * is no UTF-8, a full disk, a call out of place) is kept, nothing is written after it but a last line that tells
 * it, and visref_close tells it: no other call needs a check. Memory is taken only while a frame is longer than all
 * before it. `view` is NULL in a frame whose one view has no name. */
#ifndef VISREF_RECORDER_H
#define VISREF_RECORDER_H
#include <math.h>
#include <stddef.h>
typedef enum { VISREF_WORLD_FROM_CAMERA, VISREF_CAMERA_FROM_WORLD, VISREF_CLIP_FROM_WORLD } visref_form;
typedef enum { VISREF_ROW_MAJOR, VISREF_COLUMN_MAJOR } visref_order;
typedef struct visref_recorder visref_recorder;
/* The parts of a frame; to VISREF_NODES_, each of its views has its own. VISREF_GROUPS_ is the header's. */
enum { VISREF_KEY_, VISREF_CAMERA_, VISREF_FIELDS_, VISREF_VISIBLE_, VISREF_NODES_, VISREF_ABSENT_, VISREF_POSES_,
       VISREF_LEVELS_, VISREF_BOUNDS_, VISREF_STATS_, VISREF_MS_, VISREF_PARTS_, VISREF_BEGIN_,
       VISREF_END_, VISREF_FLUSH_, VISREF_GROUPS_ = VISREF_KEY_ };
#ifdef __cplusplus
#define VISREF_C_ extern "C"
#else
#define VISREF_C_ extern
#endif
/* What is said before the first frame is said of all: fields, groups, units. Sizes are in pixels. */
VISREF_C_ visref_recorder *visref_open(const char *file, int width, int height);
VISREF_C_ void visref_add_(visref_recorder *r, const char *view, int part, const char *format, ...);
/* 0; or 1, and in `problem` (`size` bytes; may be NULL) what first went wrong. */
VISREF_C_ int visref_close(visref_recorder *r, char *problem, size_t size);
#ifdef VISREF_RECORDER_OFF /* type-checked, and never reached */
#define visref_open(...) (0 ? visref_open(__VA_ARGS__) : (visref_recorder *)0)
#define visref_add_(...) (0 ? visref_add_(__VA_ARGS__) : (void)0)
#define visref_close(...) (0 ? visref_close(__VA_ARGS__) : 0)
#endif
#define VISREF_CALL_(name, parameters, arguments) static inline void name parameters { visref_add_ arguments; }
VISREF_CALL_(visref_begin_frame, (visref_recorder *r, int number), (r, NULL, VISREF_BEGIN_, "", number)) /* ascending */
VISREF_CALL_(visref_end_frame, (visref_recorder *r), (r, NULL, VISREF_END_, ""))
VISREF_CALL_(visref_flush, (visref_recorder *r), (r, NULL, VISREF_FLUSH_, "")) /* what is not to be lost in a crash */
VISREF_CALL_(visref_time, (visref_recorder *r, double seconds), (r, NULL, VISREF_FIELDS_, "\"time_s\":%d", seconds))
VISREF_CALL_(visref_cut, (visref_recorder *r), (r, NULL, VISREF_FIELDS_, "\"cut\":true")) /* the camera has jumped */
VISREF_CALL_(visref_camera, (visref_recorder *r, const char *view, visref_form form, visref_order order,
    const double m[16]), (r, view, VISREF_CAMERA_, "%c:%m", (int)form, (int)order, m))
VISREF_CALL_(visref_camera_f, (visref_recorder *r, const char *view, visref_form form, visref_order order,
    const float m[16]), (r, view, VISREF_CAMERA_, "%c:%f", (int)form, (int)order, m))
/* "near", "far" (HUGE_VAL: endless), "yfov" (vertical, radians) or "ymag" (half the view's height), "fps", "shift_x_px",
 * "shift_y_px"; "width" and "height" of a view of another size. */
VISREF_CALL_(visref_field, (visref_recorder *r, const char *view, const char *name, double value),
    (r, view, VISREF_FIELDS_, "%n:%e", name, value))
/* "units": a file of meshlets or batches, which `visible` then lists. Of clip_from_world, "clip_depth": "-1..1"
 * (OpenGL), "0..1", or "1..0" (reversed), and "clip_y": "down" (Vulkan). */
VISREF_CALL_(visref_text, (visref_recorder *r, const char *name, const char *text),
    (r, NULL, VISREF_FIELDS_, "%n:%n", name, text))
VISREF_CALL_(visref_group, (visref_recorder *r, const char *name, const char *const *objects, size_t count),
    (r, NULL, VISREF_GROUPS_, "%n:[%s]", name, objects, count))
VISREF_CALL_(visref_visible_name, (visref_recorder *r, const char *view, const char *name),
    (r, view, VISREF_VISIBLE_, "%n", name))
VISREF_CALL_(visref_visible_ids, (visref_recorder *r, const char *view, const int *ids, size_t count),
    (r, view, VISREF_VISIBLE_, "%a", ids, count))
VISREF_CALL_(visref_visible_nodes, (visref_recorder *r, const char *view, const int *nodes, size_t count), /* of glTF */
    (r, view, VISREF_NODES_, "%a", nodes, count))
VISREF_CALL_(visref_absent, (visref_recorder *r, const char *name), (r, NULL, VISREF_ABSENT_, "%n", name))
VISREF_CALL_(visref_pose, (visref_recorder *r, const char *name, visref_order order, const double world_from_object[16]),
    (r, NULL, VISREF_POSES_, "%n:%m", name, (int)order, world_from_object))
VISREF_CALL_(visref_pose_f, (visref_recorder *r, const char *name, visref_order order, const float world_from_object[16]),
    (r, NULL, VISREF_POSES_, "%n:%f", name, (int)order, world_from_object))
VISREF_CALL_(visref_level, (visref_recorder *r, const char *group, int level),
    (r, NULL, VISREF_LEVELS_, "%n:%i", group, (long long)level))
/* The box that was tested: its least and its greatest corner in world space. */
VISREF_CALL_(visref_bounds, (visref_recorder *r, const char *name, const double a[3], const double b[3]),
    (r, NULL, VISREF_BOUNDS_, "%n:[[%d,%d,%d],[%d,%d,%d]]", name, a[0], a[1], a[2], b[0], b[1], b[2]))
VISREF_CALL_(visref_stat, (visref_recorder *r, const char *name, long long count), (r, NULL, VISREF_STATS_, "%n:%i", name, count))
VISREF_CALL_(visref_stat_ms, (visref_recorder *r, const char *phase, double ms), (r, NULL, VISREF_MS_, "%n:%d", phase, ms))

#if defined(VISREF_RECORDER_IMPLEMENTATION) && !defined(VISREF_RECORDER_OFF)
#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#ifndef VISREF_RECORDER_BUFFER
#define VISREF_RECORDER_BUFFER 65536
#endif
#if !defined(VISREF_RECORDER_THREAD_SAFE)
#define VISREF_LOCK_(enter_or_leave) ((void)0)
#elif defined(_WIN32)
#include <windows.h>
static SRWLOCK visref_lock_ = SRWLOCK_INIT;
#define VISREF_LOCK_(enter) ((enter) ? AcquireSRWLockExclusive(&visref_lock_) : ReleaseSRWLockExclusive(&visref_lock_))
#else
#include <pthread.h>
static pthread_mutex_t visref_lock_ = PTHREAD_MUTEX_INITIALIZER;
#define VISREF_LOCK_(enter) ((enter) ? pthread_mutex_lock(&visref_lock_) : pthread_mutex_unlock(&visref_lock_))
#endif
#define VISREF_VIEWS_ 17 /* the frame itself, and sixteen with names */
typedef struct { char *at; size_t size, room; int given; } visref_text_;
struct visref_recorder {
    FILE *file; int number, in_frame, views, starved;
    visref_text_ parts[VISREF_VIEWS_][VISREF_PARTS_], line; /* a part's items are joined by commas */
    char problem[256], buffer[VISREF_RECORDER_BUFFER];
};
static void visref_fail_(visref_recorder *r, const char *what, const char *which) {
    int n = 0;
    if (r->problem[0]) return;
    if (r->number >= 0) n = snprintf(r->problem, 32, "frame %d: ", r->number);
    snprintf(r->problem + n, sizeof r->problem - 32, "%s%.160s", what, which);
}
static void visref_put_(visref_recorder *r, visref_text_ *t, const char *s, size_t size) {
    if (t->room - t->size < size) {
        size_t room = 2 * (t->size + size) + 256;
        char *at = (char *)realloc(t->at, room);
        if (!at) { r->starved = 1, visref_fail_(r, "out of memory", ""); return; }
        t->at = at, t->room = room;
    }
    if (size) memcpy(t->at + t->size, s, size), t->size += size;
}
static size_t visref_utf8_(const unsigned char *s) { /* the bytes of a well-formed character; 0: it is none */
    size_t i, n = s[0] < 0x80 ? 1 : s[0] < 0xC2 ? 0 : s[0] < 0xE0 ? 2 : s[0] < 0xF0 ? 3 : s[0] < 0xF5 ? 4 : 0;
    for (i = 1; i < n; i++) if ((s[i] & 0xC0) != 0x80) return 0;
    if ((s[0] == 0xE0 && s[1] < 0xA0) || (s[0] == 0xED && s[1] > 0x9F)) return 0;
    return (s[0] == 0xF0 && s[1] < 0x90) || (s[0] == 0xF4 && s[1] > 0x8F) ? 0 : n;
}
static void visref_string_(visref_recorder *r, visref_text_ *t, const char *string) {
    const unsigned char *s = (const unsigned char *)string;
    size_t n;
    if (!s) { visref_fail_(r, "a name is NULL", ""); return; }
    visref_put_(r, t, "\"", 1);
    for (char escaped[8]; *s; s += n) {
        if (!(n = visref_utf8_(s))) visref_fail_(r, "a name is no UTF-8: ", string);
        if (!n) n = 1, visref_put_(r, t, "\\ufffd", 6); /* as also what tells of it may have such bytes */
        else if (*s >= 0x20 && *s != '"' && *s != '\\') visref_put_(r, t, (const char *)s, n);
        else visref_put_(r, t, escaped, (size_t)snprintf(escaped, sizeof escaped, "\\u%04x", (unsigned)*s));
    }
    visref_put_(r, t, "\"", 1);
}
static void visref_number_(visref_recorder *r, visref_text_ *t, double value, int digits) {
    char s[48], *from, *to = s;
    unsigned long long bits; /* since -ffast-math takes every number for finite */
    memcpy(&bits, &value, sizeof value);
    if (!digits && bits == 0x7FFULL << 52) { visref_put_(r, t, "null", 4); return; }
    if ((bits >> 52 & 0x7FF) == 0x7FF) { visref_fail_(r, "a number is not finite", ""); return; }
    if (!(bits << 1)) { visref_put_(r, t, bits ? "-0.0" : "0.0", bits ? 4 : 3); return; }
    snprintf(s, sizeof s, "%.*g", digits ? digits : 17, value); /* reads back as the same double; 9: as the same float */
    for (from = s; *from; from++) /* the locale's decimal point, of any bytes, becomes a point */
        if (strchr("0123456789+-e", *from)) *to++ = *from;
        else if (to[-1] != '.') *to++ = '.';
    visref_put_(r, t, s, (size_t)(to - s));
}
/* %n a name, %s names, %i an integer, %a integers, %d a number, %e one that may be endless, %c a camera's form,
 * %m and %f a matrix of doubles or floats behind its order, %t a text; all else stands for itself. */
static void visref_format_(visref_recorder *r, visref_text_ *t, const char *format, va_list args) {
    static const char *const forms[] = {"world_from_camera", "camera_from_world", "clip_from_world"};
    size_t i;
    for (char s[24]; *format; format++) {
        if (*format != '%') { visref_put_(r, t, format, 1); continue; }
        if (*++format == 'n') visref_string_(r, t, va_arg(args, const char *));
        else if (*format == 'c') visref_string_(r, t, forms[va_arg(args, int)]);
        else if (*format == 'd' || *format == 'e') visref_number_(r, t, va_arg(args, double), *format == 'd' ? 17 : 0);
        else if (*format == 'i') visref_put_(r, t, s, (size_t)snprintf(s, sizeof s, "%lld", va_arg(args, long long)));
        else if (*format == 't') {
            const visref_text_ *text = va_arg(args, const visref_text_ *);
            visref_put_(r, t, text->at, text->size);
        } else if (*format == 's' || *format == 'a') {
            const char *const *names = *format == 's' ? va_arg(args, const char *const *) : NULL;
            const int *ids = *format == 'a' ? va_arg(args, const int *) : NULL;
            size_t count = va_arg(args, size_t);
            for (i = 0; i < count; i++) {
                visref_put_(r, t, ",", i > 0);
                if (names) visref_string_(r, t, names[i]);
                else visref_put_(r, t, s, (size_t)snprintf(s, sizeof s, "%d", ids[i]));
            }
        } else {
            int by_rows = va_arg(args, int) == VISREF_ROW_MAJOR;
            const double *m = *format == 'm' ? va_arg(args, const double *) : NULL;
            const float *f = m ? NULL : va_arg(args, const float *);
            for (i = 0; i < 16; i++) {
                size_t k = by_rows ? i : i % 4 * 4 + i / 4;
                visref_put_(r, t, i % 4 ? "," : i ? "],[" : "[[", i % 4 ? 1 : i ? 3 : 2);
                visref_number_(r, t, m ? m[k] : (double)f[k], m ? 17 : 9);
            }
            visref_put_(r, t, "]]", 2);
        }
    }
}
static void visref_say_(visref_recorder *r, const char *format, ...) {
    va_list args;
    va_start(args, format), visref_format_(r, &r->line, format, args), va_end(args);
}
static void visref_write_(visref_recorder *r) {
    if (!r->problem[0] && fwrite(r->line.at, 1, r->line.size, r->file) != r->line.size)
        visref_fail_(r, "cannot write: ", strerror(errno));
}
static int visref_view_(visref_recorder *r, const char *view) {
    int i = 1;
    visref_text_ *key = r->parts[1];
    if (!view) return 0;
    r->line.size = 0, visref_say_(r, "%n", view);
    for (; i < r->views && (key->size != r->line.size || memcmp(key->at, r->line.at, key->size)); key = r->parts[++i]) {}
    if (i == VISREF_VIEWS_) { visref_fail_(r, "more than 16 views", ""); return 0; }
    if (i == r->views) r->views++, visref_put_(r, key, r->line.at, r->line.size);
    return i;
}
static void visref_header_(visref_recorder *r) {
    visref_text_ *p = r->parts[0];
    r->line.size = 0, visref_say_(r, "{\"format\":\"visref-recording\",\"version\":1,%t", &p[VISREF_FIELDS_]);
    visref_say_(r, p[VISREF_GROUPS_].size ? ",\"groups\":{%t}}\n" : "}\n", &p[VISREF_GROUPS_]);
    visref_write_(r);
}
static void visref_begin_(visref_recorder *r, int number) {
    int i, k;
    if (r->number < 0) visref_header_(r);
    else if (r->in_frame) visref_fail_(r, "it has no end", "");
    if (number <= r->number) visref_fail_(r, "the next must have a higher number", "");
    for (i = 0; i < VISREF_VIEWS_; i++)
        for (k = 0; k < VISREF_PARTS_; k++) r->parts[i][k].given = 0, r->parts[i][k].size = 0;
    r->number = number, r->in_frame = r->views = 1;
}
static void visref_end_(visref_recorder *r) {
    static const char *const forms[] = {"", ",\"absent\":[%t]", ",\"world_from_object\":{%t}", ",\"levels\":{%t}", ",\"bounds\":{%t}",
        ",\"stats\":{%t%t}", ",\"stats\":{%t\"ms\":{%t}}", ",\"stats\":{%t,\"ms\":{%t}}"};
    visref_text_ (*p)[VISREF_PARTS_] = r->parts;
    int i, k, given = 0;
    if (!r->in_frame || r->number < 0) visref_fail_(r, "a call out of place", "");
    r->line.size = (size_t)(r->in_frame = 0);
    visref_say_(r, "{\"frame\":%i", (long long)r->number);
    for (i = 0; i < r->views; i++) {
        const visref_text_ *camera = &p[i][VISREF_CAMERA_], *fields = &p[i][VISREF_FIELDS_];
        if ((i || r->views == 1) && !camera->given && !p[0][VISREF_CAMERA_].given) visref_fail_(r, "no camera", "");
        if (i) visref_say_(r, i > 1 ? "},%t:{" : ",\"views\":{%t:{", &p[i][VISREF_KEY_]);
        else if (camera->given || fields->size) visref_say_(r, ",");
        visref_say_(r, camera->given && fields->size ? "%t,%t" : "%t%t", camera, fields);
        /* A bit each: ids and names in one list, or by view; nodes, or nodes by view. */
        given |= ((p[i][VISREF_VISIBLE_].given > 0) + 4 * (p[i][VISREF_NODES_].given > 0)) << (i > 0);
    }
    if (given & (given - 1)) visref_fail_(r, "what is visible is given in two ways", "");
    k = given > 2 ? VISREF_NODES_ : VISREF_VISIBLE_;
    visref_say_(r, r->views > 1 ? "}},%n:" : ",%n:", given > 2 ? "visible_nodes" : "visible");
    if (!(given & 10)) visref_say_(r, "[%t]", &p[0][k]);
    else for (i = 1; i < r->views; i++) visref_say_(r, i > 1 ? ",%t:[%t]" : "{%t:[%t]", &p[i][VISREF_KEY_], &p[i][k]);
    if (given & 10) visref_say_(r, "}");
    for (k = VISREF_ABSENT_; k <= VISREF_BOUNDS_; k++) visref_say_(r, forms[p[0][k].size ? k - VISREF_NODES_ : 0], &p[0][k]);
    k = (p[0][VISREF_STATS_].size > 0) + 2 * (p[0][VISREF_MS_].size > 0);
    visref_say_(r, forms[k ? 4 + k : 0], &p[0][VISREF_STATS_], &p[0][VISREF_MS_]);
    visref_say_(r, "}\n"), visref_write_(r);
}

void visref_add_(visref_recorder *r, const char *view, int part, const char *format, ...) {
    va_list args;
    if (!r) return;
    VISREF_LOCK_(1);
    va_start(args, format);
    if (r->problem[0]) part = VISREF_PARTS_;
    if (part == VISREF_BEGIN_) visref_begin_(r, va_arg(args, int));
    else if (part == VISREF_END_) visref_end_(r);
    else if (part == VISREF_FLUSH_ && fflush(r->file)) visref_fail_(r, "cannot write: ", strerror(errno));
    else if (part < VISREF_PARTS_) {
        visref_text_ *t = &r->parts[visref_view_(r, view)][part];
        size_t before = t->size;
        int early = r->number < 0, placed = part == VISREF_FIELDS_ || early == (part == VISREF_GROUPS_);
        if (!r->in_frame || !placed) visref_fail_(r, "a call out of place", "");
        if (t->given++ && part == VISREF_CAMERA_) visref_fail_(r, "a second camera", "");
        visref_put_(r, t, ",", before > 0);
        visref_format_(r, t, format, args);
        if (before && t->size == before + 1) t->size = before; /* an array of none */
    }
    va_end(args);
    VISREF_LOCK_(0);
}

visref_recorder *visref_open(const char *file, int width, int height) {
    visref_recorder *r = (visref_recorder *)calloc(1, sizeof *r);
    if (!r) return NULL;
    r->number = -1, r->in_frame = r->views = 1;
    if (!(r->file = fopen(file, "wb"))) visref_fail_(r, "cannot open the file: ", strerror(errno));
    else setvbuf(r->file, r->buffer, _IOFBF, sizeof r->buffer);
    visref_add_(r, NULL, VISREF_FIELDS_, "\"width\":%i,\"height\":%i", (long long)width, (long long)height);
    return r;
}

int visref_close(visref_recorder *r, char *problem, size_t size) {
    int i, k;
    if (r && r->number < 0) visref_header_(r);
    else if (r && r->in_frame) visref_fail_(r, "it has no end", "");
    if (r && r->problem[0] && r->file && !ferror(r->file)) {
        r->line.size = 0, visref_say_(r, "{\"stopped\":%n}\n", r->problem);
        if (!r->starved && !fwrite(r->line.at, 1, r->line.size, r->file)) r->starved = 1; /* as well as can be */
    }
    if (r && r->file && fclose(r->file)) visref_fail_(r, "cannot write: ", strerror(errno));
    if (problem && size) snprintf(problem, size, "%s", r ? r->problem : "out of memory");
    k = !r || r->problem[0];
    for (i = 0; r && i < VISREF_VIEWS_ * VISREF_PARTS_; i++) free(r->parts[i / VISREF_PARTS_][i % VISREF_PARTS_].at);
    if (r) free(r->line.at);
    free(r);
    return k;
}
#endif
#endif /* VISREF_RECORDER_H */
