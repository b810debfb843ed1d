/* Evaluation by the client (SPEC.md, section 23): this process moves its nodes and computes their quality.
 *
 * Without MM_EVALUATION the library has no kernels, and these functions set the error UNIMPLEMENTED.
 */
#ifndef MM_EVALUATION_H
#define MM_EVALUATION_H

#include "mm_session.h"

/* Copy the caller's mesh into session->volume, once. Does nothing if the server evaluates. */
outcome mmi_make_volume(mm_session *session);
/* Replace the blocks by the uploaded part of the mesh: its boundary, and the number of cells. */
outcome mmi_gather_blocks(mm_session *session);
/* Add the content of the next upload to the blocks, for the layers of thin cells: the cells within session->reach of
 * the walls in BUILT, and their nodes. */
outcome mmi_add_near_cells(mm_session *session, const answer *built);
/* FAILED unless the mesh that the caller gave for mm_join or mm_resume is that of the session. */
outcome mmi_check_reference(mm_session *session);

/* Displace all nodes by the field of MOVED and compute the quality of all cells; the server corrects bad cells, and
 * their quality is computed again.
 */
outcome mmi_take_trial(mm_session *session, const answer *moved, double *to);
/* All coordinates, by the field of FETCHED. */
outcome mmi_take_points(mm_session *session, const answer *fetched, double *points);
/* The trial is committed: its correction becomes that of the committed state, and no request has to be sent again. */
void mmi_keep_freed(mm_session *session);
/* Called before a derivative at the committed state: makes sure that both sides know its correction. */
outcome mmi_know_correction(mm_session *session);
/* The server no longer knows the correction. */
void mmi_forget_correction(mm_session *session);
/* Velocities (nodes, vectors * dimension) of all nodes, by the field of TANGENT_FOUND. */
outcome mmi_take_tangent(mm_session *session, size_t vectors, const answer *found, double *to);
/* Add weights (nodes, vectors * dimension) of all nodes to a COTANGENT, in the server's form; mmi_free_request frees
 * its arrays. */
outcome mmi_add_weights(mm_session *session, size_t vectors, const double *weights, request *to);
/* True if MOVED may omit all parts of the field except its coefficients. */
int mmi_knows_field(const mm_session *session);
/* The number in the mesh of a node with this number in the upload; -1: there is no such node. */
int64_t mmi_in_mesh(const mm_session *session, int64_t node);

#endif
