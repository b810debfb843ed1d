/* One connection: a DEALER socket and its monitor.
 *
 * Names that the linker sees begin with mm_ (public, mesh_motion.h), mmi_ or mmv_ (private): the sources may be
 * compiled into the caller's own program.
 */
#ifndef MM_CONNECTION_H
#define MM_CONNECTION_H

#include "mesh_motion.h"

#include <stdatomic.h>

#define ENDPOINT_BYTES 512 /* a path of ipc:// has at most 107 bytes, a host name 253 */

typedef enum { DONE, LOST, FAILED } outcome; /* LOST: the connection ended; the server may have executed the request */

typedef struct {
    void *socket, *events;
    atomic_int lent; /* frames of the caller's memory that libzmq still reads */
    char endpoint[ENDPOINT_BYTES];
} connection;

/* Keys from MESH_MOTION_KEY and MESH_MOTION_SERVER_KEY, unless mm_set_keys has set them. */
mm_result mmi_keys_of_environment(mm_context *context);
outcome mmi_connect_to(mm_context *context, connection *connection, const char *endpoint);
void mmi_disconnect(connection *connection);
/* For a forked child: it has the parent's sockets but not their threads, and closing a socket would disturb
 * the parent. */
void mmi_abandon(connection *connection);
/* LOST if the connection has ended since the last call. */
outcome mmi_check_connected(mm_context *context, connection *connection);
int mmi_is_readable(void *socket);
/* 0, or -1 if libzmq accepts no more frames. Large frames are lent, not copied. */
int mmi_send_frame(connection *connection, const uint8_t *bytes, size_t size, int more);
/* Wait until libzmq has read all lent frames. Without it the caller could not free the arrays of a request. */
void mmi_take_back_arrays(connection *connection);
/* Set UNAVAILABLE; `format` has one %s. */
outcome mmi_lost(mm_context *context, const char *format, const char *what);

#endif
