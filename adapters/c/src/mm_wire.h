/* Encoding and decoding, without sockets: frame 0 as msgpack, and the check of replies against SPEC.md.
 *
 * Nothing here trusts its input. A frame is parsed into a flat table of nodes, without recursion; every length is
 * compared with the received bytes before anything is read or allocated (SPEC.md, sections 4 to 6).
 */
#ifndef MM_WIRE_H
#define MM_WIRE_H

#include <stddef.h>
#include <stdint.h>

#if !defined(__BYTE_ORDER__) || __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "mesh_motion sends the arrays of the caller as they lie in memory: little-endian machines only"
#endif

/* Limits that the protocol sets (SPEC.md, section 6). */
#define MMI_HEADER_BYTES 65536u
#define MMI_HEADER_DEPTH 12
#define MMI_CONTAINER_ITEMS 256u
#define MMI_CHUNK_BYTES 16777216u
#define MMI_CLIENT_BYTES 16u
#define MMI_MOST_COLUMNS 65536 /* of the vectors of one message: products of sizes stay within 64 bits */
#define MMI_MOST_ARRAYS 7 /* of one reply, MOVED */

/* --- writing ----------------------------------------------------------------------------------------------------- */

/* Grows up to MMI_HEADER_BYTES; `failed` stays set after an error, so that a check at the end is sufficient. */
typedef struct {
    uint8_t *data;
    size_t size, capacity;
    int failed;
    char no_utf8[64]; /* the beginning of a text that is not UTF-8, which no message may have */
} mmi_writer;

void mmi_writer_free(mmi_writer *writer);
void mmi_put_map(mmi_writer *writer, size_t pairs);
void mmi_put_array(mmi_writer *writer, size_t items);
void mmi_put_text(mmi_writer *writer, const char *text);
void mmi_put_bytes(mmi_writer *writer, const uint8_t *bytes, size_t size); /* msgpack's bin */
void mmi_put_integer(mmi_writer *writer, int64_t value);
void mmi_put_number(mmi_writer *writer, double value);
void mmi_put_flag(mmi_writer *writer, int value);
void mmi_put_nil(mmi_writer *writer);
void mmi_put_raw(mmi_writer *writer, const uint8_t *bytes, size_t size); /* what is msgpack already */

/* --- reading ----------------------------------------------------------------------------------------------------- */

typedef enum { MMI_NIL, MMI_FLAG, MMI_INTEGER, MMI_NUMBER, MMI_TEXT, MMI_BYTES, MMI_ARRAY, MMI_MAP } mmi_kind;

/* One value of a msgpack tree; the values inside a container follow it, `next` is the first value after them. */
typedef struct {
    mmi_kind kind;
    uint32_t count; /* bytes of text and bytes, items of an array, pairs of a map */
    uint32_t next;
    union {
        int64_t integer;
        double number;
        uint32_t offset; /* of text and bytes, in the frame */
    } u;
} mmi_node;

/* A parsed frame, which the report owns; paths of the public functions start at the node `root`. */
struct mm_report {
    uint8_t *bytes;
    mmi_node *nodes;
    size_t size, count, capacity;
    uint32_t root;
};

/* Parse a frame into *report (which must be zero or freed). Returns NULL, or what is wrong with it. */
const char *mmi_parse(struct mm_report *report, const uint8_t *frame, size_t size);
void mmi_report_free(struct mm_report *report);

/* The node of a key's value; 0, which is the outermost map, if the key is not there. */
uint32_t mmi_find(const struct mm_report *report, uint32_t map, const char *key, size_t key_size);
int mmi_is_text(const struct mm_report *report, uint32_t node, const char *text);
/* Copies text, cut to the buffer, always ended; control characters become blanks. */
void mmi_copy_text(const struct mm_report *report, uint32_t node, char *buffer, size_t size);

/* --- replies ----------------------------------------------------------------------------------------------------- */

/* An array of a reply: its declaration, and its frames. */
typedef struct {
    const char *name;
    size_t rows, columns; /* columns = 1 with one axis */
    size_t width;         /* 4 or 8 bytes an item */
    size_t first_frame, frames;
} mmi_array;

typedef struct {
    struct mm_report report; /* root: the map of the fields */
    char type[32];
    uint8_t client[MMI_CLIENT_BYTES];
    int64_t sequence;
    mmi_array arrays[MMI_MOST_ARRAYS];
    size_t array_count;
} mmi_reply;

/* Frame 0 as a header: the six keys, version, type, request id. Returns NULL, or what is wrong with it. */
const char *mmi_read_header(mmi_reply *reply, const uint8_t *frame, size_t size);
/* Check fields and arrays against the table of SPEC.md, section 12; `sizes` has the sizes of all frames, including the
 * first. */
const char *mmi_read_body(mmi_reply *reply, const size_t *sizes, size_t frames);
const mmi_array *mmi_find_array(const mmi_reply *reply, const char *name);
/* Widen `count` items of 4 or 8 bytes; they need not be aligned. */
void mmi_copy_numbers(double *to, const uint8_t *from, size_t count, size_t width);
void mmi_copy_integers(int64_t *to, const uint8_t *from, size_t count, size_t width);

#endif
