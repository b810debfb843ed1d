/* One connection: a DEALER socket and its monitor.
 *
 * libzmq restores a broken connection without a message, and requests without a reply are lost. So the monitor
 * reports each end of a connection.
 */
#define _POSIX_C_SOURCE 200809L

#include "mm_context.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zmq.h>

/* Smaller arrays are copied: the copy costs less than lending the caller's memory to libzmq. */
#define LENT_BYTES ((size_t)1 << 14)

outcome mmi_lost(mm_context *context, const char *format, const char *what)
{
    char message[ENDPOINT_BYTES + 64];
    snprintf(message, sizeof message, format, what);
    mmi_fail(context, "UNAVAILABLE", "", "%s", message);
    return LOST;
}

/* --- sockets ------------------------------------------------------------------------------------------------------ */

void mmi_abandon(connection *connection)
{
    connection->socket = connection->events = NULL;
    atomic_store(&connection->lent, 0);
}

void mmi_disconnect(connection *connection)
{
    if (connection->socket) {
        zmq_socket_monitor(connection->socket, NULL, 0);
        if (connection->events) {
            zmq_close(connection->events);
        }
        zmq_close(connection->socket);
        connection->socket = connection->events = NULL;
    }
    /* without linger libzmq drops unsent frames; the call returns after that, since the caller may free the arrays */
    while (atomic_load(&connection->lent) > 0) {
        mmi_pause_for(0.001);
    }
}

static void set_option(void *socket, int option, int value) { zmq_setsockopt(socket, option, &value, sizeof value); }

static int set_keys(const mm_context *context, void *socket)
{
    return !context->secret_key[0]
           || (zmq_setsockopt(socket, ZMQ_CURVE_SERVERKEY, context->server_key, KEY_CHARACTERS + 1) == 0
               && zmq_setsockopt(socket, ZMQ_CURVE_PUBLICKEY, context->public_key, KEY_CHARACTERS + 1) == 0
               && zmq_setsockopt(socket, ZMQ_CURVE_SECRETKEY, context->secret_key, KEY_CHARACTERS + 1) == 0);
}

/* libzmq also takes what no server can listen at, such as port 99999, and waits for it */
static int is_endpoint(const char *endpoint)
{
    if (strncmp(endpoint, "tcp://", 6) != 0) {
        return strncmp(endpoint, "ipc://", 6) == 0;
    }
    const char *port = strrchr(endpoint, ':') + 1;
    size_t digits = strspn(port, "0123456789");
    return !port[digits] && digits <= 5 && atoi(port) >= 1 && atoi(port) <= 65535;
}

outcome mmi_connect_to(mm_context *context, connection *connection, const char *endpoint)
{
    char monitor[48];
    /* the largest frame of a reply, and some bytes for encryption */
    int64_t largest = MMI_CHUNK_BYTES + 4096;
    mmi_disconnect(connection);
    snprintf(connection->endpoint, sizeof connection->endpoint, "%s", endpoint);
    snprintf(monitor, sizeof monitor, "inproc://mesh-motion-%u", context->monitors++);
    void *socket = connection->socket = zmq_socket(context->zmq, ZMQ_DEALER);
    if (!socket) {
        return mmi_fail(context, "RESOURCE_EXHAUSTED", "raise the limit of open files (ulimit -n)", "no socket: %s",
                        zmq_strerror(zmq_errno()));
    }
    set_option(socket, ZMQ_LINGER, 0);
    /* a send does not wait and a receive follows a poll; these limits end a call all the same if one does wait */
    set_option(socket, ZMQ_SNDTIMEO, 60000);
    set_option(socket, ZMQ_RCVTIMEO, 60000);
    set_option(socket, ZMQ_RECONNECT_IVL, 50);
    set_option(socket, ZMQ_RECONNECT_IVL_MAX, 1000);
    set_option(socket, ZMQ_HEARTBEAT_IVL, 5000);
    set_option(socket, ZMQ_HEARTBEAT_TIMEOUT, 20000);
    set_option(socket, ZMQ_IPV6, strchr(endpoint, '[') != NULL);
    zmq_setsockopt(socket, ZMQ_MAXMSGSIZE, &largest, sizeof largest);
    int events = ZMQ_EVENT_DISCONNECTED | ZMQ_EVENT_HANDSHAKE_FAILED_AUTH | ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL;
    if (zmq_socket_monitor(socket, monitor, events) == 0) {
        connection->events = zmq_socket(context->zmq, ZMQ_PAIR);
    }
    if (!connection->events || zmq_connect(connection->events, monitor) != 0) {
        mmi_disconnect(connection);
        return mmi_fail(context, "RESOURCE_EXHAUSTED", "raise the limit of open files (ulimit -n)", "no socket: %s",
                        zmq_strerror(zmq_errno()));
    }
    if (!set_keys(context, socket)) {
        mmi_disconnect(connection);
        return mmi_fail(context, "INVALID_ARGUMENT", "a libzmq with libsodium has CURVE",
                        "libzmq does not accept the keys");
    }
    if (!is_endpoint(endpoint) || zmq_connect(socket, endpoint) != 0) {
        mmi_disconnect(connection);
        return mmi_fail(context, "INVALID_ARGUMENT", "`mesh-motion serve` prints its endpoint; ports are 1 to 65535",
                        "endpoint must be tcp://HOST:PORT or ipc:///path, got '%s'", endpoint);
    }
    return DONE;
}

int mmi_is_readable(void *socket)
{
    zmq_pollitem_t item = {socket, 0, ZMQ_POLLIN, 0};
    return zmq_poll(&item, 1, 0) > 0;
}

/* One event of the monitor has two frames; the first one has its number and a value. */
static void take_event(void *events, int *event, uint32_t *value)
{
    uint8_t head[6] = {0};
    char address[ENDPOINT_BYTES];
    uint16_t number;
    zmq_recv(events, head, sizeof head, 0);
    zmq_recv(events, address, sizeof address, 0);
    memcpy(&number, head, sizeof number);
    memcpy(value, head + 2, sizeof *value);
    *event = number;
}

outcome mmi_check_connected(mm_context *context, connection *connection)
{
    int ended = 0;
    while (mmi_is_readable(connection->events)) {
        int event;
        uint32_t value;
        take_event(connection->events, &event, &value);
        if (event == ZMQ_EVENT_HANDSHAKE_FAILED_AUTH) {
            mmi_disconnect(connection); /* the next call connects again */
            return mmi_fail(context, "UNAUTHENTICATED", "its operator admits a key with `mesh-motion keys allow`",
                            "the server at %s does not admit this key", connection->endpoint);
        }
        if (event == ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL && value == ZMQ_PROTOCOL_ERROR_ZMTP_MECHANISM_MISMATCH) {
            mmi_disconnect(connection);
            return mmi_fail(context, "UNAUTHENTICATED",
                            "give keys only for a server that was started with --keys",
                            "the server at %s and this client do not agree about the use of keys",
                            connection->endpoint);
        }
        ended = 1;
    }
    return ended ? mmi_lost(context, "the connection to %s ended", connection->endpoint) : DONE;
}

/* --- frames ------------------------------------------------------------------------------------------------------- */

static void give_back(void *data, void *lent)
{
    (void)data;
    atomic_fetch_sub((atomic_int *)lent, 1);
}

/* A large frame is the caller's memory; libzmq reads it until it calls give_back. */
static int make_frame(connection *connection, zmq_msg_t *frame, const uint8_t *bytes, size_t size)
{
    if (size < LENT_BYTES) {
        if (zmq_msg_init_size(frame, size) != 0) {
            return -1;
        }
        memcpy(zmq_msg_data(frame), bytes, size);
        return 0;
    }
    /* libzmq takes a pointer without const, but does not write to a frame that it sends */
    union {
        const uint8_t *read_only;
        void *any;
    } lent = {bytes};
    atomic_fetch_add(&connection->lent, 1);
    if (zmq_msg_init_data(frame, lent.any, size, give_back, &connection->lent) != 0) {
        atomic_fetch_sub(&connection->lent, 1);
        return -1;
    }
    return 0;
}

int mmi_send_frame(connection *connection, const uint8_t *bytes, size_t size, int more)
{
    zmq_msg_t frame;
    if (make_frame(connection, &frame, bytes, size) != 0) {
        return -1;
    }
    while (zmq_msg_send(&frame, connection->socket, ZMQ_DONTWAIT | (more ? ZMQ_SNDMORE : 0)) < 0) {
        if (zmq_errno() != EINTR) {
            zmq_msg_close(&frame);
            return -1;
        }
    }
    return 0;
}

void mmi_take_back_arrays(connection *connection)
{
    for (int i = 0; i < 50 && atomic_load(&connection->lent) > 0; ++i) {
        mmi_pause_for(0.001);
    }
    if (atomic_load(&connection->lent) > 0) {
        mmi_disconnect(connection);
    }
}

/* --- keys --------------------------------------------------------------------------------------------------------- */

/* "mesh-motion-KIND KEY NAME", one line, as `mesh-motion keys` writes it. */
static outcome read_key(mm_context *context, const char *path, const char *kind, char *key)
{
    char text[512] = "", word[32], name[80];
    struct stat status;
    FILE *file = fopen(path, "r");
    if (!file || fstat(fileno(file), &status) != 0) {
        if (file) {
            fclose(file);
        }
        return mmi_fail(context, "INVALID_ARGUMENT", "`mesh-motion keys` writes the files of keys",
                        "%s: cannot be read: %s", path, strerror(errno));
    }
    size_t size = fread(text, 1, sizeof text - 1, file);
    fclose(file);
    text[size] = '\0';
    if (strcmp(kind, "mesh-motion-secret") == 0 && (status.st_mode & 077)) {
        return mmi_fail(context, "INVALID_ARGUMENT", "make a new key if others may have read it, then chmod 600",
                        "%s: a secret key must be readable by its owner alone, got mode %04o", path,
                        (unsigned)status.st_mode & 07777u);
    }
    /* 41: so that a longer word is detected */
    char found[KEY_CHARACTERS + 2];
    if (sscanf(text, "%31s %41s %79s", word, found, name) != 3 || strcmp(word, kind) != 0
        || strlen(found) != KEY_CHARACTERS) {
        return mmi_fail(context, "INVALID_ARGUMENT", "give the file as `mesh-motion keys` wrote it",
                        "%s: expected one line '%s KEY NAME'", path, kind);
    }
    memcpy(key, found, KEY_CHARACTERS + 1);
    return DONE;
}

mm_result mm_set_keys(mm_context *context, const char *secret_file, const char *server_key)
{
    BEGIN(context);
    if (!secret_file || !server_key) {
        mmi_fail(context, "INVALID_ARGUMENT", "give both files, or none for a server without --keys",
                 "both keys must be given: the client's secret one and the server's public one");
        return context->error;
    }
    char secret[KEY_CHARACTERS + 1], public[KEY_CHARACTERS + 1], server[KEY_CHARACTERS + 1] = "";
    if (read_key(context, secret_file, "mesh-motion-secret", secret) != DONE) {
        return context->error;
    }
    if (strlen(server_key) == KEY_CHARACTERS && access(server_key, F_OK) != 0) {
        memcpy(server, server_key, sizeof server);
    } else if (read_key(context, server_key, "mesh-motion-public", server) != DONE) {
        return context->error;
    }
    if (zmq_curve_public(public, secret) != 0) {
        mmi_fail(context, "INVALID_ARGUMENT", "a libzmq with libsodium has CURVE", "%s: libzmq does not accept the key",
                 secret_file);
        return context->error;
    }
    memcpy(context->secret_key, secret, sizeof secret);
    memcpy(context->public_key, public, sizeof public);
    memcpy(context->server_key, server, sizeof server);
    return MM_OK;
}

mm_result mmi_keys_of_environment(mm_context *context)
{
    const char *secret = getenv("MESH_MOTION_KEY"), *server = getenv("MESH_MOTION_SERVER_KEY");
    secret = secret && *secret ? secret : NULL;
    server = server && *server ? server : NULL;
    if (context->secret_key[0] || (!secret && !server)) {
        return MM_OK;
    }
    if (!secret || !server) {
        mmi_fail(context, "INVALID_ARGUMENT", "set both, or neither for a server without --keys",
                 "only one of MESH_MOTION_KEY and MESH_MOTION_SERVER_KEY is set");
        return context->error;
    }
    return mm_set_keys(context, secret, server);
}
