/* msgpack, limited to the parts that SPEC.md admits, and the table of the replies. See mm_wire.h. */
#include "mm_wire.h"

#include "mesh_motion.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* --- writing ----------------------------------------------------------------------------------------------------- */

void mmi_writer_free(mmi_writer *writer)
{
    free(writer->data);
    *writer = (mmi_writer){0};
}

static uint8_t *more_room(mmi_writer *writer, size_t size)
{
    if (writer->failed || size > MMI_HEADER_BYTES - writer->size) {
        writer->failed = 1;
        return NULL;
    }
    if (writer->size + size > writer->capacity) {
        size_t capacity = writer->capacity ? writer->capacity : 256;
        while (capacity < writer->size + size) {
            capacity *= 2;
        }
        uint8_t *data = realloc(writer->data, capacity);
        if (!data) {
            writer->failed = 1;
            return NULL;
        }
        writer->data = data;
        writer->capacity = capacity;
    }
    uint8_t *at = writer->data + writer->size;
    writer->size += size;
    return at;
}

/* A first byte, then `bytes` bytes of a number, big-endian as in msgpack. */
static void put_head(mmi_writer *writer, unsigned first, uint64_t value, size_t bytes)
{
    uint8_t *at = more_room(writer, 1 + bytes);
    if (!at) {
        return;
    }
    at[0] = (uint8_t)first;
    for (size_t i = 0; i < bytes; ++i) {
        at[1 + i] = (uint8_t)(value >> (8 * (bytes - 1 - i)));
    }
}

void mmi_put_raw(mmi_writer *writer, const uint8_t *bytes, size_t size)
{
    uint8_t *at = more_room(writer, size);
    if (at && size) {
        memcpy(at, bytes, size);
    }
}

void mmi_put_map(mmi_writer *writer, size_t pairs)
{
    put_head(writer, pairs < 16 ? 0x80u | (unsigned)pairs : 0xdeu, pairs, pairs < 16 ? 0 : 2);
}

void mmi_put_array(mmi_writer *writer, size_t items)
{
    put_head(writer, items < 16 ? 0x90u | (unsigned)items : 0xdcu, items, items < 16 ? 0 : 2);
}

/* SPEC 4.2: text is UTF-8; overlong forms, surrogates and values above U+10FFFF are invalid. */
static int is_utf8(const uint8_t *text, size_t size)
{
    for (size_t i = 0; i < size;) {
        uint8_t first = text[i++];
        if (first < 0x80) {
            continue;
        }
        size_t more = first >= 0xf0 ? 3 : first >= 0xe0 ? 2 : 1;
        if (first < 0xc2 || first > 0xf4 || more > size - i) {
            return 0;
        }
        uint8_t low = first == 0xe0 ? 0xa0 : first == 0xf0 ? 0x90 : 0x80;
        uint8_t high = first == 0xed ? 0x9f : first == 0xf4 ? 0x8f : 0xbf;
        if (text[i] < low || text[i] > high) {
            return 0;
        }
        for (++i; --more; ++i) {
            if (text[i] < 0x80 || text[i] > 0xbf) {
                return 0;
            }
        }
    }
    return 1;
}

void mmi_put_text(mmi_writer *writer, const char *text)
{
    size_t size = strlen(text);
    if (!writer->failed && !is_utf8((const uint8_t *)text, size)) {
        writer->failed = 1;
        snprintf(writer->no_utf8, sizeof writer->no_utf8, "%s", text);
    }
    if (size < 32) {
        put_head(writer, 0xa0u | (unsigned)size, 0, 0);
    } else {
        put_head(writer, size < 256 ? 0xd9u : 0xdau, size, size < 256 ? 1 : 2);
    }
    mmi_put_raw(writer, (const uint8_t *)text, size);
}

void mmi_put_bytes(mmi_writer *writer, const uint8_t *bytes, size_t size)
{
    put_head(writer, size < 256 ? 0xc4u : 0xc5u, size, size < 256 ? 1 : 2);
    mmi_put_raw(writer, bytes, size);
}

void mmi_put_integer(mmi_writer *writer, int64_t value)
{
    if (value >= -32 && value < 128) {
        put_head(writer, (uint8_t)value, 0, 0);
    } else if (value >= 0 && value <= UINT32_MAX) {
        put_head(writer,
                 value < 256     ? 0xccu
                 : value < 65536 ? 0xcdu
                                 : 0xceu,
                 (uint64_t)value,
                 value < 256     ? 1
                 : value < 65536 ? 2
                                 : 4);
    } else {
        put_head(writer, 0xd3u, (uint64_t)value, 8);
    }
}

void mmi_put_number(mmi_writer *writer, double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    put_head(writer, 0xcbu, bits, 8);
}

void mmi_put_flag(mmi_writer *writer, int value) { put_head(writer, value ? 0xc3u : 0xc2u, 0, 0); }

void mmi_put_nil(mmi_writer *writer) { put_head(writer, 0xc0u, 0, 0); }

/* --- parsing ----------------------------------------------------------------------------------------------------- */

void mmi_report_free(struct mm_report *report)
{
    free(report->bytes);
    free(report->nodes);
    *report = (struct mm_report){0};
}

typedef struct {
    const uint8_t *bytes;
    size_t size, at;
    const char *wrong;
} cursor;

/* A big-endian number of `bytes` bytes; sets `wrong` if the frame ends too early. */
static uint64_t take(cursor *in, size_t bytes)
{
    uint64_t value = 0;
    if (in->wrong || bytes > in->size - in->at) {
        in->wrong = "it ends too early";
        return 0;
    }
    for (size_t i = 0; i < bytes; ++i) {
        value = value << 8 | in->bytes[in->at++];
    }
    return value;
}

static void take_string(cursor *in, mmi_node *node, mmi_kind kind, uint64_t size)
{
    node->kind = kind;
    if (in->wrong || size > in->size - in->at) {
        in->wrong = "it ends too early";
        return;
    }
    node->count = (uint32_t)size;
    node->u.offset = (uint32_t)in->at;
    if (kind == MMI_TEXT && !is_utf8(in->bytes + in->at, (size_t)size)) {
        in->wrong = "a text is not UTF-8";
    }
    in->at += (size_t)size;
}

static void take_container(cursor *in, mmi_node *node, mmi_kind kind, uint64_t items)
{
    node->kind = kind;
    node->count = (uint32_t)items;
    if (items > MMI_CONTAINER_ITEMS) {
        in->wrong = "a map or array has too many items";
    }
}

static void set_integer(cursor *in, mmi_node *node, uint64_t value)
{
    node->kind = MMI_INTEGER;
    if (value > INT64_MAX) {
        in->wrong = "an integer is larger than 63 bits";
        return;
    }
    node->u.integer = (int64_t)value;
}

/* Two's complement of `bytes` bytes. */
static void take_signed(cursor *in, mmi_node *node, size_t bytes)
{
    uint64_t value = take(in, bytes);
    uint64_t sign = UINT64_C(1) << (8 * bytes - 1);
    node->kind = MMI_INTEGER;
    node->u.integer = value & sign ? -(int64_t)((sign | (sign - 1)) - value) - 1 : (int64_t)value;
}

static void take_float(cursor *in, mmi_node *node, int wide)
{
    node->kind = MMI_NUMBER;
    if (wide) {
        uint64_t bits = take(in, 8);
        memcpy(&node->u.number, &bits, sizeof bits);
    } else {
        uint32_t bits = (uint32_t)take(in, 4);
        float number;
        memcpy(&number, &bits, sizeof bits);
        node->u.number = (double)number;
    }
}

/* One value; for a container only its head. */
static void take_value(cursor *in, mmi_node *node)
{
    unsigned first = (unsigned)take(in, 1);
    *node = (mmi_node){0};
    if (in->wrong) {
        return;
    }
    if (first < 0x80) {
        set_integer(in, node, first);
    } else if (first < 0x90) {
        take_container(in, node, MMI_MAP, first & 15u);
    } else if (first < 0xa0) {
        take_container(in, node, MMI_ARRAY, first & 15u);
    } else if (first < 0xc0) {
        take_string(in, node, MMI_TEXT, first & 31u);
    } else if (first >= 0xe0) {
        node->kind = MMI_INTEGER;
        node->u.integer = (int64_t)first - 256;
    } else {
        switch (first) {
        case 0xc0: node->kind = MMI_NIL; break;
        case 0xc2:
        case 0xc3:
            node->kind = MMI_FLAG;
            node->u.integer = first == 0xc3;
            break;
        case 0xc4:
        case 0xc5:
        case 0xc6: take_string(in, node, MMI_BYTES, take(in, (size_t)1 << (first - 0xc4))); break;
        case 0xca:
        case 0xcb: take_float(in, node, first == 0xcb); break;
        case 0xcc:
        case 0xcd:
        case 0xce:
        case 0xcf: set_integer(in, node, take(in, (size_t)1 << (first - 0xcc))); break;
        case 0xd0:
        case 0xd1:
        case 0xd2:
        case 0xd3: take_signed(in, node, (size_t)1 << (first - 0xd0)); break;
        case 0xd9:
        case 0xda:
        case 0xdb: take_string(in, node, MMI_TEXT, take(in, (size_t)1 << (first - 0xd9))); break;
        case 0xdc:
        case 0xdd: take_container(in, node, MMI_ARRAY, take(in, first == 0xdc ? 2 : 4)); break;
        case 0xde:
        case 0xdf: take_container(in, node, MMI_MAP, take(in, first == 0xde ? 2 : 4)); break;
        default: in->wrong = "it has a type that is not admitted"; /* 0xc1 and extensions, SPEC 4.3 */
        }
    }
}

static mmi_node *new_node(struct mm_report *report)
{
    if (report->count == report->capacity) {
        /* each node has taken a byte of the frame, so there are at most MMI_HEADER_BYTES */
        size_t capacity = report->capacity ? 2 * report->capacity : 64;
        mmi_node *nodes = realloc(report->nodes, capacity * sizeof *nodes);
        if (!nodes) {
            return NULL;
        }
        report->nodes = nodes;
        report->capacity = capacity;
    }
    return &report->nodes[report->count++];
}

static int same_text(const struct mm_report *report, const mmi_node *node, const char *text, size_t size)
{
    return node->kind == MMI_TEXT && node->count == size
           && (size == 0 || memcmp(report->bytes + node->u.offset, text, size) == 0);
}

/* SPEC 4.1: with a duplicate key two readers could see two different messages. */
static const char *check_keys(const struct mm_report *report)
{
    for (uint32_t map = 0; map < report->count; ++map) {
        if (report->nodes[map].kind != MMI_MAP) {
            continue;
        }
        for (uint32_t key = map + 1; key < report->nodes[map].next; key = report->nodes[key + 1].next) {
            const mmi_node *node = &report->nodes[key];
            if (node->kind != MMI_TEXT) {
                return "a key is not text";
            }
            const char *text = (const char *)report->bytes + node->u.offset;
            for (uint32_t other = report->nodes[key + 1].next; other < report->nodes[map].next;
                 other = report->nodes[other + 1].next) {
                if (report->nodes[other].kind != MMI_TEXT) {
                    return "a key is not text"; /* nor would its value be the next node */
                }
                if (same_text(report, &report->nodes[other], text, node->count)) {
                    return "a key comes twice";
                }
            }
        }
    }
    return NULL;
}

static const char *parse_nodes(struct mm_report *report)
{
    struct {
        uint32_t node;
        size_t left;
    } open[MMI_HEADER_DEPTH];
    int depth = 0;
    cursor in = {report->bytes, report->size, 0, NULL};
    do {
        mmi_node *node = new_node(report);
        if (!node) {
            return "there is no memory for it";
        }
        uint32_t index = (uint32_t)(report->count - 1);
        take_value(&in, node);
        if (in.wrong) {
            return in.wrong;
        }
        node->next = index + 1;
        if (node->kind == MMI_ARRAY || node->kind == MMI_MAP) {
            if (depth == MMI_HEADER_DEPTH) {
                return "it is nested too deep";
            }
            open[depth].node = index;
            open[depth++].left = node->kind == MMI_MAP ? 2 * (size_t)node->count : node->count;
        } else if (depth) {
            --open[depth - 1].left;
        }
        while (depth && open[depth - 1].left == 0) {
            report->nodes[open[--depth].node].next = (uint32_t)report->count;
            if (depth) {
                --open[depth - 1].left;
            }
        }
    } while (depth);
    return in.at < in.size ? "something follows it" : check_keys(report);
}

const char *mmi_parse(struct mm_report *report, const uint8_t *frame, size_t size)
{
    *report = (struct mm_report){0};
    if (size == 0 || size > MMI_HEADER_BYTES) {
        return size ? "it is too large" : "it is empty";
    }
    report->bytes = malloc(size);
    if (!report->bytes) {
        return "there is no memory for it";
    }
    memcpy(report->bytes, frame, size);
    report->size = size;
    const char *wrong = parse_nodes(report);
    if (!wrong && report->nodes[0].kind != MMI_MAP) {
        wrong = "it is not a map";
    }
    if (wrong) {
        mmi_report_free(report);
    }
    return wrong;
}

uint32_t mmi_find(const struct mm_report *report, uint32_t map, const char *key, size_t key_size)
{
    if (report->nodes[map].kind != MMI_MAP) {
        return 0;
    }
    for (uint32_t at = map + 1; at < report->nodes[map].next; at = report->nodes[at + 1].next) {
        if (same_text(report, &report->nodes[at], key, key_size)) {
            return at + 1;
        }
    }
    return 0;
}

int mmi_is_text(const struct mm_report *report, uint32_t node, const char *text)
{
    return same_text(report, &report->nodes[node], text, strlen(text));
}

void mmi_copy_text(const struct mm_report *report, uint32_t node, char *buffer, size_t size)
{
    const mmi_node *from = &report->nodes[node];
    size_t count = from->kind == MMI_TEXT ? from->count : 0;
    count = count < size - 1 ? count : size - 1;
    for (size_t i = 0; i < count; ++i) {
        uint8_t byte = report->bytes[from->u.offset + i];
        buffer[i] = byte < 0x20 || byte == 0x7f ? ' ' : (char)byte;
    }
    buffer[count] = '\0';
}

/* --- the table of the replies (SPEC.md, section 12) -------------------------------------------------------------- */

typedef struct {
    const char *name;
    mmi_kind kind;
    int of; /* kind of the items of an array or map; -1: any */
    int optional;
    uint32_t size; /* bytes that a field of bytes has */
} field_rule;

typedef struct {
    const char *name;
    char item; /* 'f' or 'i' */
    int columns; /* 0: it has one axis; else the longest that the second one may be */
    int optional;
} array_rule;

#define MOST_FIELDS 11
typedef struct {
    const char *type;
    field_rule fields[MOST_FIELDS];
    array_rule arrays[MMI_MOST_ARRAYS];
} reply_rule;

#define TEXT(name) {name, MMI_TEXT, -1, 0, 0}
#define INTEGER(name) {name, MMI_INTEGER, -1, 0, 0}
#define OPTIONAL_INTEGER(name) {name, MMI_INTEGER, -1, 1, 0}
#define BYTES(name, size) {name, MMI_BYTES, -1, 0, size}
#define MAP(name) {name, MMI_MAP, -1, 0, 0}
#define LIST(name, of) {name, MMI_ARRAY, of, 0, 0}

/* of a field that the client evaluates (section 23) */
#define FIELD_SUMS {"sums", MMI_ARRAY, MMI_MAP, 1, 0}
#define FIELD_ARRAYS {"centres", 'f', 3, 1}, {"boxes", 'f', 14, 1}, {"coefficients", 'f', 3, 1}

static const reply_rule RULES[] = {
    {"WELCOME",
     {LIST("version", MMI_INTEGER),
      LIST("features", MMI_TEXT),
      TEXT("server"),
      BYTES("boot", 16),
      {"limits", MMI_MAP, MMI_INTEGER, 0, 0},
      LIST("durability", MMI_TEXT)},
     {{0}}},
    {"OPENED", {TEXT("session"), BYTES("token", 32), TEXT("endpoint"), INTEGER("epoch")}, {{0}}},
    {"RESUMED", {TEXT("session"), TEXT("endpoint"), INTEGER("epoch"), TEXT("state"), INTEGER("step")}, {{0}}},
    {"LISTED", {LIST("sessions", MMI_MAP), {"more", MMI_FLAG, -1, 1, 0}}, {{0}}},
    {"PROBED", {TEXT("session"), TEXT("worker"), INTEGER("epoch"), {"endpoint", MMI_TEXT, -1, 1, 0}}, {{0}}},
    {"PONG", {{0}}, {{0}}},
    {"JOINED",
     {TEXT("state"), INTEGER("step"), INTEGER("iteration"), OPTIONAL_INTEGER("dimension"),
      OPTIONAL_INTEGER("partitions"), OPTIONAL_INTEGER("nodes"), {"evaluation", MMI_TEXT, -1, 1, 0},
      {"extent", MMI_NUMBER, -1, 1, 0}, {"time", MMI_NUMBER, -1, 1, 0}, {"moving_patches", MMI_ARRAY, MMI_ARRAY, 1, 0}},
     {{"moving_nodes", 'i', 0, 1}, {"patch_nodes", 'i', 0, 1}}},
    {"UPLOADED", {INTEGER("rows_total")}, {{0}}},
    {"BUILT",
     {INTEGER("step"),
      MAP("settings"),
      MAP("mesh"),
      MAP("quality"),
      {"derivatives", MMI_FLAG, -1, 1, 0},
      {"reach", MMI_NUMBER, -1, 1, 0}},
     {{"moving_nodes", 'i', 0, 0}, {"wall", 'f', 9, 1}}},
    {"MOVED",
     {INTEGER("step"),
      INTEGER("iteration"),
      MAP("quality"),
      MAP("correction"),
      MAP("caches"),
      {"seconds", MMI_MAP, MMI_NUMBER, 0, 0},
      LIST("warnings", MMI_TEXT),
      {"faces", MMI_MAP, -1, 1, 0},
      {"headroom", MMI_MAP, -1, 1, 0},
      FIELD_SUMS},
     {{"displacement", 'f', 3, 0}, {"velocity", 'f', 3, 1}, {"swept", 'f', 0, 1}, {"enrichment_points", 'f', 3, 0},
      FIELD_ARRAYS}},
    {"TANGENT_FOUND",
     {INTEGER("step"), INTEGER("iteration")},
     {{"velocity", 'f', MMI_MOST_COLUMNS, 0}, {"coefficients", 'f', MMI_MOST_COLUMNS, 1}, {"freed", 'i', 0, 1},
      {"freed_velocity", 'f', MMI_MOST_COLUMNS, 1}}},
    {"COTANGENT_FOUND", {INTEGER("step"), INTEGER("iteration")}, {{"weights", 'f', MMI_MOST_COLUMNS, 0}}},
    {"JUDGED",
     {INTEGER("step"),
      LIST("questions", MMI_MAP),
      MAP("quality"),
      {"reached", MMI_FLAG, -1, 0, 0},
      LIST("warnings", MMI_TEXT),
      {"correction", MMI_MAP, -1, 1, 0},
      {"region", MMI_MAP, -1, 1, 0}},
     {{0}}},
    {"CORRECTED", {INTEGER("step"), MAP("region")}, {{"nodes", 'i', 0, 0}, {"displacement", 'f', 3, 0}}},
    {"COMMITTED", {INTEGER("step"), INTEGER("durable_step"), BYTES("digest", 32), MAP("quality")}, {{0}}},
    {"ROLLED_BACK", {INTEGER("step")}, {{0}}},
    {"FETCHED",
     {INTEGER("step"), FIELD_SUMS, {"region", MMI_MAP, -1, 1, 0}},
     {{"points", 'f', 3, 0}, FIELD_ARRAYS, {"nodes", 'i', 0, 1}}},
    {"STATUS_REPORT",
     {TEXT("state"), INTEGER("step"), INTEGER("iteration"), LIST("waiting_for", MMI_INTEGER), MAP("report"),
      OPTIONAL_INTEGER("durable_step")},
     {{0}}},
    {"CLOSED", {INTEGER("step")}, {{0}}},
    {"ERROR",
     {TEXT("code"), TEXT("message"), TEXT("hint"), {"retryable", MMI_FLAG, -1, 0, 0}, TEXT("state"), MAP("details")},
     {{0}}},
};

static int is_kind(const mmi_node *node, int kind)
{
    return kind < 0 || (int)node->kind == kind || (kind == MMI_NUMBER && node->kind == MMI_INTEGER);
}

static int fits(const struct mm_report *report, uint32_t value, const field_rule *rule)
{
    const mmi_node *node = &report->nodes[value];
    if (!is_kind(node, (int)rule->kind) || (rule->size && node->count != rule->size)) {
        return 0;
    }
    if (rule->of >= 0) {
        int is_map = node->kind == MMI_MAP;
        for (uint32_t at = value + 1; at < node->next;) {
            uint32_t item = is_map ? at + 1 : at;
            if (!is_kind(&report->nodes[item], rule->of)) {
                return 0;
            }
            at = report->nodes[item].next;
        }
    }
    return 1;
}

static const char *check_fields(const struct mm_report *report, const reply_rule *rule)
{
    for (size_t i = 0; i < MOST_FIELDS && rule->fields[i].name; ++i) {
        const field_rule *field = &rule->fields[i];
        uint32_t value = mmi_find(report, report->root, field->name, strlen(field->name));
        if (!value && !field->optional) {
            return "a field is missing";
        }
        if (value && !fits(report, value, field)) {
            return "a field has the wrong type";
        }
    }
    return NULL;
}

/* One axis; anything above 2^40 rows is nonsense, and keeps the products below within 64 bits. */
static int read_axis(const mmi_node *node, size_t *length)
{
    if (node->kind != MMI_INTEGER || node->u.integer < 0 || node->u.integer > INT64_C(1) << 40) {
        return 0;
    }
    *length = (size_t)node->u.integer;
    return 1;
}

static const char *read_array(mmi_reply *reply, uint32_t declared, const reply_rule *rule)
{
    const struct mm_report *report = &reply->report;
    const mmi_node *nodes = report->nodes;
    uint32_t name = mmi_find(report, declared, "name", 4);
    uint32_t dtype = mmi_find(report, declared, "dtype", 5), shape = mmi_find(report, declared, "shape", 5);
    if (nodes[declared].kind != MMI_MAP || nodes[declared].count != 3 || !name || !dtype || !shape) {
        return "an array must be declared by name, dtype and shape";
    }
    const array_rule *known = NULL;
    for (size_t i = 0; i < MMI_MOST_ARRAYS && rule->arrays[i].name; ++i) {
        known = mmi_is_text(report, name, rule->arrays[i].name) ? &rule->arrays[i] : known;
    }
    if (!known || mmi_find_array(reply, known->name)) {
        return "it declares an array that it does not have, or twice";
    }
    mmi_array *array = &reply->arrays[reply->array_count];
    char wide[] = {'<', known->item, '8', '\0'}, narrow[] = {'<', known->item, '4', '\0'};
    array->width = mmi_is_text(report, dtype, wide) ? 8 : mmi_is_text(report, dtype, narrow) ? 4 : 0;
    array->columns = 1;
    if (!array->width) {
        return "an array has another dtype";
    }
    if (nodes[shape].kind != MMI_ARRAY || nodes[shape].count != (known->columns ? 2u : 1u)
        || !read_axis(&nodes[shape + 1], &array->rows)) {
        return "an array has another shape";
    }
    if (known->columns
        && (!read_axis(&nodes[shape + 2], &array->columns) || array->columns < 1
            || array->columns > (size_t)known->columns)) {
        return "an array has another shape";
    }
    array->name = known->name;
    ++reply->array_count;
    return NULL;
}

/* SPEC 5.3: chunks of exactly MMI_CHUNK_BYTES, the last one shorter; no frame without bytes, no frame too many. */
static const char *check_frames(mmi_reply *reply, const size_t *sizes, size_t frames)
{
    size_t next = 1;
    for (size_t i = 0; i < reply->array_count; ++i) {
        mmi_array *array = &reply->arrays[i];
        uint64_t left = (uint64_t)array->rows * array->columns * array->width;
        array->first_frame = next;
        for (; left; ++next) {
            uint64_t chunk = left < MMI_CHUNK_BYTES ? left : MMI_CHUNK_BYTES;
            if (next >= frames || sizes[next] != chunk) {
                return "its frames are not those of the arrays that it declares";
            }
            left -= chunk;
        }
        array->frames = next - array->first_frame;
    }
    return next == frames ? NULL : "its frames are not those of the arrays that it declares";
}

const char *mmi_read_header(mmi_reply *reply, const uint8_t *frame, size_t size)
{
    static const char *const KEYS[] = {"v", "type", "client", "sequence", "fields", "arrays"};
    uint32_t at[6];
    *reply = (mmi_reply){0};
    struct mm_report *report = &reply->report;
    const char *wrong = mmi_parse(report, frame, size);
    if (wrong) {
        return wrong;
    }
    for (size_t i = 0; i < 6; ++i) {
        at[i] = mmi_find(report, 0, KEYS[i], strlen(KEYS[i]));
        /* the version before the other keys: another version may have other keys */
        if (i == 0 && (!at[0] || report->nodes[at[0]].kind != MMI_INTEGER || report->nodes[at[0]].u.integer != 1)) {
            return "it is of another protocol version";
        }
        if (!at[i]) {
            return "a key is missing";
        }
    }
    const mmi_node *nodes = report->nodes;
    if (nodes[0].count != 6 || nodes[at[1]].kind != MMI_TEXT || nodes[at[2]].kind != MMI_BYTES
        || nodes[at[2]].count != MMI_CLIENT_BYTES || nodes[at[3]].kind != MMI_INTEGER || nodes[at[3]].u.integer < 0
        || nodes[at[4]].kind != MMI_MAP || nodes[at[5]].kind != MMI_ARRAY) {
        return "its keys are not those of a header";
    }
    mmi_copy_text(report, at[1], reply->type, sizeof reply->type);
    memcpy(reply->client, report->bytes + nodes[at[2]].u.offset, MMI_CLIENT_BYTES);
    reply->sequence = nodes[at[3]].u.integer;
    report->root = at[4];
    return NULL;
}

const char *mmi_read_body(mmi_reply *reply, const size_t *sizes, size_t frames)
{
    const struct mm_report *report = &reply->report;
    const reply_rule *rule = NULL;
    for (size_t i = 0; i < sizeof RULES / sizeof *RULES; ++i) {
        rule = strcmp(reply->type, RULES[i].type) == 0 ? &RULES[i] : rule;
    }
    if (!rule) {
        return "there is no such reply";
    }
    const char *wrong = check_fields(report, rule);
    uint32_t arrays = mmi_find(report, 0, "arrays", 6);
    for (uint32_t at = arrays + 1; !wrong && at < report->nodes[arrays].next; at = report->nodes[at].next) {
        wrong = read_array(reply, at, rule);
    }
    for (size_t i = 0; !wrong && i < MMI_MOST_ARRAYS && rule->arrays[i].name; ++i) {
        if (!rule->arrays[i].optional && !mmi_find_array(reply, rule->arrays[i].name)) {
            wrong = "an array is missing";
        }
    }
    return wrong ? wrong : check_frames(reply, sizes, frames);
}

const mmi_array *mmi_find_array(const mmi_reply *reply, const char *name)
{
    for (size_t i = 0; i < reply->array_count; ++i) {
        if (strcmp(reply->arrays[i].name, name) == 0) {
            return &reply->arrays[i];
        }
    }
    return NULL;
}

void mmi_copy_numbers(double *to, const uint8_t *from, size_t count, size_t width)
{
    if (width == 8) {
        memcpy(to, from, 8 * count);
        return;
    }
    for (size_t i = 0; i < count; ++i) {
        float narrow;
        memcpy(&narrow, from + 4 * i, 4);
        to[i] = (double)narrow;
    }
}

void mmi_copy_integers(int64_t *to, const uint8_t *from, size_t count, size_t width)
{
    if (width == 8) {
        memcpy(to, from, 8 * count);
        return;
    }
    for (size_t i = 0; i < count; ++i) {
        int32_t narrow;
        memcpy(&narrow, from + 4 * i, 4);
        to[i] = narrow;
    }
}

/* --- reports, as the public header has them ---------------------------------------------------------------------- */

/* The node at a path of keys and indices with dots between them, or 0. */
static uint32_t at_path(const mm_report *report, const char *path)
{
    if (!report || !report->count || !path) {
        return 0;
    }
    uint32_t at = report->root;
    while (*path) {
        size_t size = strcspn(path, ".");
        const mmi_node *node = &report->nodes[at];
        if (node->kind == MMI_ARRAY) {
            char *end;
            unsigned long index = strtoul(path, &end, 10);
            if (end != path + size || size == 0 || index >= node->count) {
                return 0;
            }
            for (++at; index; --index) {
                at = report->nodes[at].next;
            }
        } else if (!(at = mmi_find(report, at, path, size))) {
            return 0;
        }
        path += size;
        path += *path == '.';
    }
    return at;
}

double mm_report_number(const mm_report *report, const char *path)
{
    uint32_t at = at_path(report, path);
    if (at && (report->nodes[at].kind == MMI_INTEGER || report->nodes[at].kind == MMI_FLAG)) {
        return (double)report->nodes[at].u.integer;
    }
    return at && report->nodes[at].kind == MMI_NUMBER ? report->nodes[at].u.number : NAN;
}

int64_t mm_report_integer(const mm_report *report, const char *path, int64_t otherwise)
{
    uint32_t at = at_path(report, path);
    if (at && (report->nodes[at].kind == MMI_INTEGER || report->nodes[at].kind == MMI_FLAG)) {
        return report->nodes[at].u.integer;
    }
    return otherwise;
}

size_t mm_report_count(const mm_report *report, const char *path)
{
    uint32_t at = at_path(report, path);
    return at && (report->nodes[at].kind == MMI_ARRAY || report->nodes[at].kind == MMI_MAP) ? report->nodes[at].count
                                                                                            : 0;
}

size_t mm_report_text(const mm_report *report, const char *path, char *buffer, size_t size)
{
    uint32_t at = at_path(report, path);
    int is_text = at && report->nodes[at].kind == MMI_TEXT;
    if (size) {
        buffer[0] = '\0';
        if (is_text) {
            mmi_copy_text(report, at, buffer, size);
        }
    }
    return is_text ? report->nodes[at].count : 0;
}

/* The output of JSON: it continues to count when the buffer is full, as snprintf does. */
typedef struct {
    char *buffer;
    size_t size, used;
} sink;

static void put_char(sink *out, char c)
{
    if (out->used + 1 < out->size) {
        out->buffer[out->used] = c;
    }
    ++out->used;
}

static void put_string(sink *out, const char *text)
{
    while (*text) {
        put_char(out, *text++);
    }
}

static void json_text(sink *out, const uint8_t *text, size_t size)
{
    put_char(out, '"');
    for (size_t i = 0; i < size; ++i) {
        if (text[i] < 0x20 || text[i] == 0x7f) {
            char escaped[8];
            snprintf(escaped, sizeof escaped, "\\u%04x", text[i]);
            put_string(out, escaped);
        } else {
            if (text[i] == '"' || text[i] == '\\') {
                put_char(out, '\\');
            }
            put_char(out, (char)text[i]);
        }
    }
    put_char(out, '"');
}

static void json_bytes(sink *out, const uint8_t *bytes, size_t size)
{
    static const char DIGITS[] = "0123456789abcdef";
    put_char(out, '"');
    for (size_t i = 0; i < size; ++i) {
        put_char(out, DIGITS[bytes[i] >> 4]);
        put_char(out, DIGITS[bytes[i] & 15]);
    }
    put_char(out, '"');
}

static void json_number(sink *out, double value)
{
    char text[40];
    if (!isfinite(value)) {
        put_string(out, "null"); /* JSON has no such value */
        return;
    }
    snprintf(text, sizeof text, "%.17g", value);
    for (char *c = text; *c; ++c) {
        /* the program's locale may use a decimal comma */
        put_char(out, strchr("0123456789+-eE", *c) ? *c : '.');
    }
}

static void json_scalar(sink *out, const mm_report *report, const mmi_node *node)
{
    char text[32];
    switch (node->kind) {
    case MMI_FLAG: put_string(out, node->u.integer ? "true" : "false"); break;
    case MMI_INTEGER:
        snprintf(text, sizeof text, "%lld", (long long)node->u.integer);
        put_string(out, text);
        break;
    case MMI_NUMBER: json_number(out, node->u.number); break;
    case MMI_TEXT: json_text(out, report->bytes + node->u.offset, node->count); break;
    case MMI_BYTES: json_bytes(out, report->bytes + node->u.offset, node->count); break;
    default: put_string(out, "null");
    }
}

size_t mm_report_json(const mm_report *report, const char *path, char *buffer, size_t size)
{
    struct {
        uint32_t end;
        int is_map, items;
    } open[MMI_HEADER_DEPTH];
    int depth = 0;
    sink out = {buffer, size, 0};
    uint32_t at = at_path(report, path);
    uint32_t end = at ? report->nodes[at].next : 0;
    if (!at) {
        put_string(&out, "null");
    }
    while (at < end) {
        const mmi_node *node = &report->nodes[at];
        if (depth) { /* in a map keys and values alternate */
            int items = open[depth - 1].items++;
            if (open[depth - 1].is_map && items % 2) {
                put_char(&out, ':');
            } else if (items) {
                put_char(&out, ',');
            }
        }
        if (node->kind == MMI_MAP || node->kind == MMI_ARRAY) {
            put_char(&out, node->kind == MMI_MAP ? '{' : '[');
            open[depth].end = node->next;
            open[depth].is_map = node->kind == MMI_MAP;
            open[depth++].items = 0;
        } else {
            json_scalar(&out, report, node);
        }
        ++at;
        while (depth && at == open[depth - 1].end) {
            put_char(&out, open[--depth].is_map ? '}' : ']');
        }
    }
    if (size) {
        buffer[out.used < size ? out.used : size - 1] = '\0';
    }
    return out.used;
}
