/* The mesh: the caller's arrays and their check. */
#ifndef MM_MESH_H
#define MM_MESH_H

#include "mm_session.h"

mm_result mmi_add_block(mm_session *session, const block *added);
/* Nodes of a cell of a type; 0: there is no such type. */
size_t mmi_corners_of(const char *type);
void mmi_free_blocks(mm_session *session);
size_t mmi_mesh_bytes(const mm_session *session);
/* Numbers must be finite, and indices must be those of nodes. The error names the first wrong row. */
outcome mmi_check_rows(mm_context *context, const block *rows, size_t nodes, const char *what);
outcome mmi_check_mesh(mm_session *session);
/* So many rows has a Fortran array of another shape. */
#define MMI_OTHER_SHAPE ((size_t)INT64_MAX)
/* That neither of two numbers of rows is this one. */
outcome mmi_check_shape(mm_session *session, size_t first, size_t second);

void mmi_free_freed(freed *old);
/* Free the requests of the trial that the server has accepted. */
void mmi_forget_accepted(mm_session *session);
void mmi_forget_volume(mm_session *session);

#endif
