/* Puts frames to the client's decoder.
 *
 *     wire_check < FRAMES
 *     wire_check COUNT SEED < FRAMES
 *
 * Each line of FRAMES is a message: frames as hexadecimal text, with blanks
 * between them. The first form prints a line for each: empty, or WRONG and the
 * reason. The second decodes COUNT mutations of these lines: the decoder must
 * not read or write outside a message. */
#include "mesh_motion.h"
#include "mm_wire.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MOST_FRAMES = 8, MOST_LINES = 1024, LINE_BYTES = 400000 };

typedef struct {
    uint8_t *frames[MOST_FRAMES];
    size_t sizes[MOST_FRAMES], count;
} message;

static message lines[MOST_LINES];
static size_t line_count;

static uint64_t state;
static size_t below(size_t limit)
{
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return limit ? (size_t)(state % limit) : 0;
}

static message read_line(char *text)
{
    message read = {0};
    text[strcspn(text, "\n")] = '\0';
    for (char *at = text; read.count < MOST_FRAMES; ++read.count) {
        size_t size = strcspn(at, " ") / 2;
        uint8_t *frame = malloc(size ? size : 1);
        for (size_t i = 0; i < size; ++i) {
            unsigned byte = 0;
            sscanf(at + 2 * i, "%2x", &byte);
            frame[i] = (uint8_t)byte;
        }
        read.frames[read.count] = frame;
        read.sizes[read.count] = size;
        at += 2 * size;
        if (*at++ != ' ') {
            ++read.count;
            break;
        }
    }
    return read;
}

static void free_message(message *old)
{
    for (size_t i = 0; i < old->count; ++i) {
        free(old->frames[i]);
    }
    old->count = 0;
}

/* Everything that the client does with a reply: the report in every way, all
 * items of all arrays. */
static void use(mmi_reply *reply, const message *from, int show)
{
    size_t size = mm_report_json(&reply->report, "", NULL, 0) + 1;
    char *text = malloc(size), small[8];
    mm_report_json(&reply->report, "", text, size);
    mm_report_json(&reply->report, "quality.corrected.worst.0", small, sizeof small);
    mm_report_text(&reply->report, "state", small, sizeof small);
    volatile double sum = mm_report_number(&reply->report, "quality.corrected.metric.min");
    sum += (double)mm_report_integer(&reply->report, "version.0", 0);
    sum += (double)mm_report_count(&reply->report, "warnings");
    if (show) {
        printf("%s %s", reply->type, text);
    }
    for (size_t a = 0; a < reply->array_count; ++a) {
        const mmi_array *array = &reply->arrays[a];
        if (show) {
            printf(" %s(%zu,%zu)", array->name, array->rows, array->columns);
        }
        double *numbers = malloc((array->rows * array->columns + 1) * sizeof *numbers), *at = numbers;
        int64_t *integers = malloc((array->rows * array->columns + 1) * sizeof *integers), *next = integers;
        for (size_t f = array->first_frame; f < array->first_frame + array->frames; ++f) {
            size_t count = from->sizes[f] / array->width;
            mmi_copy_numbers(at, from->frames[f], count, array->width);
            mmi_copy_integers(next, from->frames[f], count, array->width);
            at += count;
            next += count;
        }
        free(numbers);
        free(integers);
    }
    free(text);
}

static const char *read_message(const message *from, int show)
{
    mmi_reply reply;
    const char *wrong = mmi_read_header(&reply, from->frames[0], from->sizes[0]);
    if (!wrong) {
        wrong = mmi_read_body(&reply, from->sizes, from->count);
    }
    if (!wrong) {
        use(&reply, from, show);
    }
    mmi_report_free(&reply.report);
    return wrong;
}

static message mutate(const message *from)
{
    message made = *from;
    for (size_t i = 0; i < made.count; ++i) {
        /* exactly as much memory as there are bytes, so that the sanitizer sees one
         * too many */
        size_t old = made.sizes[i], cut = below(4) == 0 ? below(old + (i ? 17 : 1)) : old;
        made.frames[i] = calloc(cut ? cut : 1, 1);
        memcpy(made.frames[i], from->frames[i], cut < old ? cut : old);
        made.sizes[i] = cut;
    }
    for (size_t n = below(6); n > 0 && made.sizes[0]; --n) {
        static const uint8_t NASTY[] = {0x00, 0x7f, 0x80, 0x8f, 0x9f, 0xbf, 0xc1, 0xc4,
                                        0xc6, 0xd9, 0xdb, 0xdc, 0xdd, 0xde, 0xdf, 0xff};
        size_t at = below(made.sizes[0]);
        uint8_t *byte = &made.frames[0][at];
        switch (below(4)) {
        case 0: *byte ^= (uint8_t)(1u << below(8)); break;
        case 1: *byte = NASTY[below(sizeof NASTY)]; break;
        case 2: *byte = (uint8_t)below(256); break;
        default: { /* a piece of another message over it */
            const message *other = &lines[below(line_count)];
            size_t start = below(other->sizes[0] + 1), size = below(32);
            size = size < other->sizes[0] - start ? size : other->sizes[0] - start;
            size = size < made.sizes[0] - at ? size : made.sizes[0] - at;
            memcpy(byte, other->frames[0] + start, size);
        }
        }
    }
    return made;
}

int main(int count, char **arguments)
{
    static char text[LINE_BYTES];
    while (line_count < MOST_LINES && fgets(text, sizeof text, stdin)) {
        lines[line_count++] = read_line(text);
    }
    if (count < 3) {
        for (size_t i = 0; i < line_count; ++i) {
            const char *wrong = read_message(&lines[i], 1);
            printf("%s%s\n", wrong ? "WRONG " : "", wrong ? wrong : "");
        }
    } else {
        size_t good = 0;
        state = strtoull(arguments[2], NULL, 10) * UINT64_C(2654435761) + 1;
        for (long n = atol(arguments[1]); n > 0; --n) {
            message made = mutate(&lines[below(line_count)]);
            good += read_message(&made, 0) == NULL;
            free_message(&made);
        }
        printf("%zu of %s were still messages\n", good, arguments[1]);
    }
    for (size_t i = 0; i < line_count; ++i) {
        free_message(&lines[i]);
    }
    return 0;
}
