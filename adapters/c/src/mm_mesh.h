/* The mesh: the caller's arrays, their check, and their upload. */
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

#endif
