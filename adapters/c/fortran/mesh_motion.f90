! The client of the mesh-motion server in Fortran, over mesh_motion.h.
!
!     use mesh_motion
!     type(mm_server) :: server
!     type(mm_session) :: session
!     call server%connect("tcp://127.0.0.1:7440")
!     call session%create(server)
!     call session%points(points)                       ! (dimension, nodes)
!     call session%cells("quad", quads)                 ! (4, cells)
!     call session%patch("block", "moving", block)
!     call session%set("support_radius", 0.5d0)
!     call session%open()
!     call session%build()
!     moving = session%moving_nodes()
!     call session%move(rows, displacement)             ! once per coupling iteration
!     call session%commit()                             ! once per time step
!     call session%close()
!     if (server%failed()) print *, server%error_message()
!     call server%free()
!
! Nodes count from 1 here; in messages, and in the texts of errors, they count from 0 (error_hint says so).
! Errors are sticky: the first one stays in the server, and every later call does nothing until clear_error. The arrays
! of the mesh are copied, so they may be temporaries.
module mesh_motion
   use, intrinsic :: iso_c_binding, only: c_ptr, c_null_ptr, c_associated, c_f_pointer, c_loc, c_char, c_null_char, &
                                          c_int, c_int8_t, c_int32_t, c_int64_t, c_double, c_size_t
   implicit none
   private
   public :: mm_server, mm_session
   public :: mm_since_committed, mm_since_reference, mm_keep, mm_discard
   public :: mm_built, mm_moved, mm_committed, mm_status_report, mm_joined

   integer(c_int), parameter :: mm_since_committed = 0, mm_since_reference = 1 ! what a displacement counts from
   integer(c_int), parameter :: mm_keep = 0, mm_discard = 1                    ! whether a closed session is kept
   integer, parameter :: mm_built = 1, mm_moved = 2, mm_committed = 3, mm_status_report = 4, mm_joined = 5 ! the last replies
   integer, parameter :: id_size = 32, token_size = 32

   type :: mm_server
      type(c_ptr) :: handle = c_null_ptr
   contains
      procedure :: connect => server_connect
      procedure :: ping => server_ping
      procedure :: welcome => server_welcome
      procedure :: list => server_list
      procedure :: listed => server_listed
      procedure :: failed => server_failed
      procedure :: error_code => server_error_code
      procedure :: error_message => server_error_message
      procedure :: error_hint => server_error_hint
      procedure :: error_detail => server_error_detail
      procedure :: clear_error => server_clear_error
      procedure :: free => server_free
   end type mm_server

   ! Copies that the C library reads until the mesh is built.
   type :: kept
      integer(c_int64_t), allocatable :: indices(:)
      real(c_double), allocatable :: numbers(:, :)
      type(kept), pointer :: next => null()
   end type kept

   type :: mm_session
      type(c_ptr) :: handle = c_null_ptr
      type(kept), pointer, private :: copies => null()
   contains
      procedure :: create => session_create
      procedure :: free => session_free
      procedure :: points => session_points
      procedure, private :: session_cells_32, session_cells_64, session_patch_32, session_patch_64
      procedure, private :: session_ids_32, session_ids_64
      generic :: cells => session_cells_32, session_cells_64
      generic :: patch => session_patch_32, session_patch_64
      generic :: global_ids => session_ids_32, session_ids_64
      procedure, private :: session_set_number, session_set_integer, session_set_flag, session_set_text
      generic :: set => session_set_number, session_set_integer, session_set_flag, session_set_text
      procedure :: label => session_label
      procedure :: durability => session_durability
      procedure :: evaluation => session_evaluation
      procedure :: partition => session_partition
      procedure :: open => session_open
      procedure :: join => session_join
      procedure :: build => session_build
      procedure :: resume => session_resume
      procedure :: credentials => session_credentials
      procedure :: use_credentials => session_use_credentials
      procedure :: save_credentials => session_save_credentials
      procedure :: load_credentials => session_load_credentials
      procedure :: report => session_report
      procedure :: compute_limit => session_compute_limit
      procedure :: final_step => session_final_step
      procedure :: time_levels => session_time_levels
      procedure :: time => session_time
      procedure :: velocity_scheme => session_velocity_scheme
      procedure :: boundary_velocity => session_boundary_velocity
      procedure :: swept_faces => session_swept_faces
      procedure :: all_swept_faces => session_all_swept_faces
      procedure :: headroom_along => session_headroom_along
      procedure :: velocity => session_velocity
      procedure :: swept => session_swept
      procedure :: move => session_move
      procedure, private :: tangent_one, tangent_all, cotangent_one, cotangent_all
      generic :: tangent => tangent_one, tangent_all
      generic :: cotangent => cotangent_one, cotangent_all
      procedure :: commit => session_commit
      procedure :: rollback => session_rollback
      procedure :: fetch => session_fetch
      procedure :: status => session_status
      procedure :: close => session_close
      procedure :: dimension => session_dimension
      procedure :: node_count => session_node_count
      procedure :: moving_nodes => session_moving_nodes
      procedure :: patch_nodes => session_patch_nodes
      procedure :: step => session_step
      procedure :: durable_step => session_durable_step
      procedure :: iteration => session_iteration
      procedure :: state => session_state
      procedure :: number => session_number
      procedure :: json => session_json
   end type mm_session

   interface
      function c_context_new() bind(c, name="mm_context_new")
         import :: c_ptr
         type(c_ptr) :: c_context_new
      end function
      subroutine c_context_free(context) bind(c, name="mm_context_free")
         import :: c_ptr
         type(c_ptr), value :: context
      end subroutine
      function c_set_timeouts(context, seconds, compute_seconds) bind(c, name="mm_set_timeouts")
         import :: c_ptr, c_double, c_int
         type(c_ptr), value :: context
         real(c_double), value :: seconds, compute_seconds
         integer(c_int) :: c_set_timeouts
      end function
      function c_set_keys(context, secret_file, server_key) bind(c, name="mm_set_keys")
         import :: c_ptr, c_char, c_int
         type(c_ptr), value :: context
         character(kind=c_char), intent(in) :: secret_file(*), server_key(*)
         integer(c_int) :: c_set_keys
      end function
      function c_connect(context, endpoint) bind(c, name="mm_connect")
         import :: c_ptr, c_char, c_int
         type(c_ptr), value :: context
         character(kind=c_char), intent(in) :: endpoint(*)
         integer(c_int) :: c_connect
      end function
      function c_ping(context) bind(c, name="mm_ping")
         import :: c_ptr, c_int
         type(c_ptr), value :: context
         integer(c_int) :: c_ping
      end function
      function c_welcome(context) bind(c, name="mm_welcome")
         import :: c_ptr
         type(c_ptr), value :: context
         type(c_ptr) :: c_welcome
      end function
      function c_list(context, after) bind(c, name="mm_list")
         import :: c_ptr, c_char, c_int
         type(c_ptr), value :: context
         character(kind=c_char), intent(in) :: after(*)
         integer(c_int) :: c_list
      end function
      function c_listed(context) bind(c, name="mm_listed")
         import :: c_ptr
         type(c_ptr), value :: context
         type(c_ptr) :: c_listed
      end function
      function c_error(context) bind(c, name="mm_error")
         import :: c_ptr, c_int
         type(c_ptr), value :: context
         integer(c_int) :: c_error
      end function
      function c_error_code(context) bind(c, name="mm_error_code")
         import :: c_ptr
         type(c_ptr), value :: context
         type(c_ptr) :: c_error_code
      end function
      function c_error_message(context) bind(c, name="mm_error_message")
         import :: c_ptr
         type(c_ptr), value :: context
         type(c_ptr) :: c_error_message
      end function
      function c_error_hint(context) bind(c, name="mm_error_hint")
         import :: c_ptr
         type(c_ptr), value :: context
         type(c_ptr) :: c_error_hint
      end function
      function c_error_details(context) bind(c, name="mm_error_details")
         import :: c_ptr
         type(c_ptr), value :: context
         type(c_ptr) :: c_error_details
      end function
      subroutine c_clear_error(context) bind(c, name="mm_clear_error")
         import :: c_ptr
         type(c_ptr), value :: context
      end subroutine
      function c_session_new(context) bind(c, name="mm_session_new")
         import :: c_ptr
         type(c_ptr), value :: context
         type(c_ptr) :: c_session_new
      end function
      subroutine c_session_free(session) bind(c, name="mm_session_free")
         import :: c_ptr
         type(c_ptr), value :: session
      end subroutine
      function c_points(session, dimension, nodes, points) bind(c, name="mm_points")
         import :: c_ptr, c_int, c_size_t
         type(c_ptr), value :: session, points
         integer(c_int), value :: dimension
         integer(c_size_t), value :: nodes
         integer(c_int) :: c_points
      end function
      function c_cells(session, type, cells, nodes) bind(c, name="mm_cells")
         import :: c_ptr, c_char, c_size_t, c_int
         type(c_ptr), value :: session, nodes
         character(kind=c_char), intent(in) :: type(*)
         integer(c_size_t), value :: cells
         integer(c_int) :: c_cells
      end function
      function c_patch(session, name, role, nodes, indices) bind(c, name="mm_patch")
         import :: c_ptr, c_char, c_size_t, c_int
         type(c_ptr), value :: session, indices
         character(kind=c_char), intent(in) :: name(*), role(*)
         integer(c_size_t), value :: nodes
         integer(c_int) :: c_patch
      end function
      function c_global_ids(session, ids) bind(c, name="mm_global_ids")
         import :: c_ptr, c_int
         type(c_ptr), value :: session, ids
         integer(c_int) :: c_global_ids
      end function
      function c_set_number(session, key, value) bind(c, name="mm_set_number")
         import :: c_ptr, c_char, c_double, c_int
         type(c_ptr), value :: session
         character(kind=c_char), intent(in) :: key(*)
         real(c_double), value :: value
         integer(c_int) :: c_set_number
      end function
      function c_set_integer(session, key, value) bind(c, name="mm_set_integer")
         import :: c_ptr, c_char, c_int64_t, c_int
         type(c_ptr), value :: session
         character(kind=c_char), intent(in) :: key(*)
         integer(c_int64_t), value :: value
         integer(c_int) :: c_set_integer
      end function
      function c_set_flag(session, key, value) bind(c, name="mm_set_flag")
         import :: c_ptr, c_char, c_int
         type(c_ptr), value :: session
         character(kind=c_char), intent(in) :: key(*)
         integer(c_int), value :: value
         integer(c_int) :: c_set_flag
      end function
      function c_set_text(session, key, value) bind(c, name="mm_set_text")
         import :: c_ptr, c_char, c_int
         type(c_ptr), value :: session
         character(kind=c_char), intent(in) :: key(*), value(*)
         integer(c_int) :: c_set_text
      end function
      function c_set_label(session, label) bind(c, name="mm_set_label")
         import :: c_ptr, c_char, c_int
         type(c_ptr), value :: session
         character(kind=c_char), intent(in) :: label(*)
         integer(c_int) :: c_set_label
      end function
      function c_set_durability(session, durability) bind(c, name="mm_set_durability")
         import :: c_ptr, c_char, c_int
         type(c_ptr), value :: session
         character(kind=c_char), intent(in) :: durability(*)
         integer(c_int) :: c_set_durability
      end function
      function c_set_evaluation(session, evaluation) bind(c, name="mm_set_evaluation")
         import :: c_ptr, c_char, c_int
         type(c_ptr), value :: session
         character(kind=c_char), intent(in) :: evaluation(*)
         integer(c_int) :: c_set_evaluation
      end function
      function c_set_report(session, report) bind(c, name="mm_set_report")
         import :: c_ptr, c_char, c_int
         type(c_ptr), value :: session
         character(kind=c_char), intent(in) :: report(*)
         integer(c_int) :: c_set_report
      end function
      function c_set_compute_limit(session, seconds) bind(c, name="mm_set_compute_limit")
         import :: c_ptr, c_int, c_double
         type(c_ptr), value :: session
         real(c_double), value :: seconds
         integer(c_int) :: c_set_compute_limit
      end function
      function c_set_final_step(session, step) bind(c, name="mm_set_final_step")
         import :: c_ptr, c_int, c_int64_t
         type(c_ptr), value :: session
         integer(c_int64_t), value :: step
         integer(c_int) :: c_set_final_step
      end function
      function c_set_time_levels(session, start, scheme) bind(c, name="mm_set_time_levels")
         import :: c_ptr, c_int, c_double, c_char
         type(c_ptr), value :: session
         real(c_double), value :: start
         character(kind=c_char), intent(in) :: scheme(*)
         integer(c_int) :: c_set_time_levels
      end function
      function c_set_time(session, time) bind(c, name="mm_set_time")
         import :: c_ptr, c_int, c_double
         type(c_ptr), value :: session
         real(c_double), value :: time
         integer(c_int) :: c_set_time
      end function
      function c_set_velocity(session, scheme) bind(c, name="mm_set_velocity")
         import :: c_ptr, c_int, c_char
         type(c_ptr), value :: session
         character(kind=c_char), intent(in) :: scheme(*)
         integer(c_int) :: c_set_velocity
      end function
      function c_set_boundary_velocity(session, moving, velocity) bind(c, name="mm_set_boundary_velocity")
         import :: c_ptr, c_int, c_size_t, c_double
         type(c_ptr), value :: session
         integer(c_size_t), value :: moving
         real(c_double), intent(in) :: velocity(*)
         integer(c_int) :: c_set_boundary_velocity
      end function
      function c_set_swept_faces(session, faces, corners, nodes) bind(c, name="mm_set_swept_faces")
         import :: c_ptr, c_int, c_size_t
         type(c_ptr), value :: session
         integer(c_size_t), value :: faces, corners
         type(c_ptr), value :: nodes
         integer(c_int) :: c_set_swept_faces
      end function
      function c_set_headroom_along(session, way) bind(c, name="mm_set_headroom_along")
         import :: c_ptr, c_int, c_char
         type(c_ptr), value :: session
         character(kind=c_char), intent(in) :: way(*)
         integer(c_int) :: c_set_headroom_along
      end function
      function c_velocity(session, count) bind(c, name="mm_velocity")
         import :: c_ptr, c_size_t
         type(c_ptr), value :: session
         integer(c_size_t), intent(out) :: count
         type(c_ptr) :: c_velocity
      end function
      function c_swept(session, count) bind(c, name="mm_swept")
         import :: c_ptr, c_size_t
         type(c_ptr), value :: session
         integer(c_size_t), intent(out) :: count
         type(c_ptr) :: c_swept
      end function
      function c_set_partition(session, partition, partitions) bind(c, name="mm_set_partition")
         import :: c_ptr, c_int
         type(c_ptr), value :: session
         integer(c_int), value :: partition, partitions
         integer(c_int) :: c_set_partition
      end function
      function c_open(session) bind(c, name="mm_open")
         import :: c_ptr, c_int
         type(c_ptr), value :: session
         integer(c_int) :: c_open
      end function
      function c_join(session) bind(c, name="mm_join")
         import :: c_ptr, c_int
         type(c_ptr), value :: session
         integer(c_int) :: c_join
      end function
      function c_build(session) bind(c, name="mm_build")
         import :: c_ptr, c_int
         type(c_ptr), value :: session
         integer(c_int) :: c_build
      end function
      function c_resume(session) bind(c, name="mm_resume")
         import :: c_ptr, c_int
         type(c_ptr), value :: session
         integer(c_int) :: c_resume
      end function
      function c_id(session) bind(c, name="mm_id")
         import :: c_ptr
         type(c_ptr), value :: session
         type(c_ptr) :: c_id
      end function
      function c_token(session) bind(c, name="mm_token")
         import :: c_ptr
         type(c_ptr), value :: session
         type(c_ptr) :: c_token
      end function
      function c_set_credentials(session, id, token) bind(c, name="mm_set_credentials")
         import :: c_ptr, c_char, c_int8_t, c_int
         type(c_ptr), value :: session
         character(kind=c_char), intent(in) :: id(*)
         integer(c_int8_t), intent(in) :: token(*)
         integer(c_int) :: c_set_credentials
      end function
      function c_save_credentials(session, path) bind(c, name="mm_save_credentials")
         import :: c_ptr, c_char, c_int
         type(c_ptr), value :: session
         character(kind=c_char), intent(in) :: path(*)
         integer(c_int) :: c_save_credentials
      end function
      function c_load_credentials(session, path) bind(c, name="mm_load_credentials")
         import :: c_ptr, c_char, c_int
         type(c_ptr), value :: session
         character(kind=c_char), intent(in) :: path(*)
         integer(c_int) :: c_load_credentials
      end function
      function c_move(session, frame, moving, displacement, nodes, answer) bind(c, name="mm_move")
         import :: c_ptr, c_int, c_size_t, c_double
         type(c_ptr), value :: session
         integer(c_int), value :: frame
         integer(c_size_t), value :: moving, nodes
         real(c_double), intent(in) :: displacement(*)
         real(c_double), intent(inout) :: answer(*)
         integer(c_int) :: c_move
      end function
      function c_tangent(session, vectors, moving, velocity, nodes, answer) bind(c, name="mm_tangent")
         import :: c_ptr, c_int, c_size_t, c_double
         type(c_ptr), value :: session
         integer(c_size_t), value :: vectors, moving, nodes
         real(c_double), intent(in) :: velocity(*)
         real(c_double), intent(inout) :: answer(*)
         integer(c_int) :: c_tangent
      end function
      function c_cotangent(session, vectors, nodes, weights, moving, answer) bind(c, name="mm_cotangent")
         import :: c_ptr, c_int, c_size_t, c_double
         type(c_ptr), value :: session
         integer(c_size_t), value :: vectors, nodes, moving
         real(c_double), intent(in) :: weights(*)
         real(c_double), intent(inout) :: answer(*)
         integer(c_int) :: c_cotangent
      end function
      function c_commit(session) bind(c, name="mm_commit")
         import :: c_ptr, c_int
         type(c_ptr), value :: session
         integer(c_int) :: c_commit
      end function
      function c_rollback(session) bind(c, name="mm_rollback")
         import :: c_ptr, c_int
         type(c_ptr), value :: session
         integer(c_int) :: c_rollback
      end function
      function c_fetch(session, which, nodes, points) bind(c, name="mm_fetch")
         import :: c_ptr, c_int, c_size_t, c_double
         type(c_ptr), value :: session
         integer(c_int), value :: which
         integer(c_size_t), value :: nodes
         real(c_double), intent(inout) :: points(*)
         integer(c_int) :: c_fetch
      end function
      function c_status(session) bind(c, name="mm_status")
         import :: c_ptr, c_int
         type(c_ptr), value :: session
         integer(c_int) :: c_status
      end function
      function c_close(session, outcome) bind(c, name="mm_close")
         import :: c_ptr, c_int
         type(c_ptr), value :: session
         integer(c_int), value :: outcome
         integer(c_int) :: c_close
      end function
      function c_dimension(session) bind(c, name="mm_dimension")
         import :: c_ptr, c_int
         type(c_ptr), value :: session
         integer(c_int) :: c_dimension
      end function
      function c_node_count(session) bind(c, name="mm_node_count")
         import :: c_ptr, c_size_t
         type(c_ptr), value :: session
         integer(c_size_t) :: c_node_count
      end function
      function c_moving_nodes(session, count) bind(c, name="mm_moving_nodes")
         import :: c_ptr, c_size_t
         type(c_ptr), value :: session
         integer(c_size_t), intent(out) :: count
         type(c_ptr) :: c_moving_nodes
      end function
      function c_patch_nodes(session, name, count) bind(c, name="mm_patch_nodes")
         import :: c_ptr, c_char, c_size_t
         type(c_ptr), value :: session
         character(kind=c_char), intent(in) :: name(*)
         integer(c_size_t), intent(out) :: count
         type(c_ptr) :: c_patch_nodes
      end function
      function c_step(session) bind(c, name="mm_step")
         import :: c_ptr, c_int64_t
         type(c_ptr), value :: session
         integer(c_int64_t) :: c_step
      end function
      function c_durable_step(session) bind(c, name="mm_durable_step")
         import :: c_ptr, c_int64_t
         type(c_ptr), value :: session
         integer(c_int64_t) :: c_durable_step
      end function
      function c_iteration(session) bind(c, name="mm_iteration")
         import :: c_ptr, c_int64_t
         type(c_ptr), value :: session
         integer(c_int64_t) :: c_iteration
      end function
      function c_state(session) bind(c, name="mm_state")
         import :: c_ptr
         type(c_ptr), value :: session
         type(c_ptr) :: c_state
      end function
      function c_joined(session) bind(c, name="mm_joined")
         import :: c_ptr
         type(c_ptr), value :: session
         type(c_ptr) :: c_joined
      end function
      function c_built(session) bind(c, name="mm_built")
         import :: c_ptr
         type(c_ptr), value :: session
         type(c_ptr) :: c_built
      end function
      function c_moved(session) bind(c, name="mm_moved")
         import :: c_ptr
         type(c_ptr), value :: session
         type(c_ptr) :: c_moved
      end function
      function c_committed(session) bind(c, name="mm_committed")
         import :: c_ptr
         type(c_ptr), value :: session
         type(c_ptr) :: c_committed
      end function
      function c_status_report(session) bind(c, name="mm_status_report")
         import :: c_ptr
         type(c_ptr), value :: session
         type(c_ptr) :: c_status_report
      end function
      function c_report_number(report, path) bind(c, name="mm_report_number")
         import :: c_ptr, c_char, c_double
         type(c_ptr), value :: report
         character(kind=c_char), intent(in) :: path(*)
         real(c_double) :: c_report_number
      end function
      function c_report_json(report, path, buffer, size) bind(c, name="mm_report_json")
         import :: c_ptr, c_char, c_size_t
         type(c_ptr), value :: report
         character(kind=c_char), intent(in) :: path(*)
         character(kind=c_char), intent(inout) :: buffer(*)
         integer(c_size_t), value :: size
         integer(c_size_t) :: c_report_json
      end function
      function c_strlen(text) bind(c, name="strlen")
         import :: c_ptr, c_size_t
         type(c_ptr), value :: text
         integer(c_size_t) :: c_strlen
      end function
   end interface

contains

   ! --- text ---------------------------------------------------------------------------------------------------------

   function ended(text)
      character(*), intent(in) :: text
      character(len_trim(text) + 1, c_char) :: ended
      ended = trim(text)//c_null_char
   end function

   function from_c(text) result(copy)
      type(c_ptr), intent(in) :: text
      character(:), allocatable :: copy
      character(kind=c_char), pointer :: characters(:)
      integer :: i
      allocate (character(int(c_strlen(text))) :: copy)
      call c_f_pointer(text, characters, [len(copy)])
      do i = 1, len(copy)
         copy(i:i) = characters(i)
      end do
   end function

   function json_of(report, path) result(text)
      type(c_ptr), intent(in) :: report
      character(*), intent(in) :: path
      character(:), allocatable :: text
      character(1, c_char) :: none(1)
      integer(c_size_t) :: size
      size = c_report_json(report, ended(path), none, 0_c_size_t)
      allocate (character(int(size) + 1) :: text)
      size = c_report_json(report, ended(path), text, size + 1)
      text = text(:len(text) - 1)
   end function

   ! --- a server -----------------------------------------------------------------------------------------------------

   ! Time-outs in seconds of small requests and of computations; the two keys for a server that needs them.
   subroutine server_connect(self, endpoint, seconds, compute_seconds, secret_file, server_key)
      class(mm_server), intent(inout) :: self
      character(*), intent(in) :: endpoint
      real(c_double), intent(in), optional :: seconds, compute_seconds
      character(*), intent(in), optional :: secret_file, server_key
      real(c_double) :: wait, compute
      integer(c_int) :: ignored
      if (.not. c_associated(self%handle)) self%handle = c_context_new()
      wait = 60
      compute = 1800
      if (present(seconds)) wait = seconds
      if (present(compute_seconds)) compute = compute_seconds
      ignored = c_set_timeouts(self%handle, wait, compute)
      if (present(secret_file) .and. present(server_key)) then
         ignored = c_set_keys(self%handle, ended(secret_file), ended(server_key))
      else if (present(secret_file)) then ! one without the other is an error of the C library
         ignored = c_set_keys(self%handle, ended(secret_file), ended(""))
      else if (present(server_key)) then
         ignored = c_set_keys(self%handle, ended(""), ended(server_key))
      end if
      ignored = c_connect(self%handle, ended(endpoint))
   end subroutine

   subroutine server_ping(self)
      class(mm_server), intent(in) :: self
      integer(c_int) :: ignored
      ignored = c_ping(self%handle)
   end subroutine

   ! The server's WELCOME, as JSON: "version", "limits", "server", "durability".
   function server_welcome(self, path) result(text)
      class(mm_server), intent(in) :: self
      character(*), intent(in) :: path
      character(:), allocatable :: text
      text = json_of(c_welcome(self%handle), path)
   end function

   ! List the sessions after an id (absent: from the first on), as many as one reply can hold; while listed("more") is
   ! 1, there are others.
   subroutine server_list(self, after)
      class(mm_server), intent(in) :: self
      character(*), intent(in), optional :: after
      integer(c_int) :: ignored
      if (present(after)) then
         ignored = c_list(self%handle, ended(after))
      else
         ignored = c_list(self%handle, ended(""))
      end if
   end subroutine

   ! The reply to list(), as JSON: "sessions", "sessions.0.state", "more".
   function server_listed(self, path) result(text)
      class(mm_server), intent(in) :: self
      character(*), intent(in) :: path
      character(:), allocatable :: text
      text = json_of(c_listed(self%handle), path)
   end function

   function server_failed(self) result(failed)
      class(mm_server), intent(in) :: self
      logical :: failed
      failed = c_error(self%handle) /= 0
   end function

   function server_error_code(self) result(text)
      class(mm_server), intent(in) :: self
      character(:), allocatable :: text
      text = from_c(c_error_code(self%handle))
   end function

   function server_error_message(self) result(text)
      class(mm_server), intent(in) :: self
      character(:), allocatable :: text
      text = from_c(c_error_message(self%handle))
   end function

   function server_error_hint(self) result(text)
      class(mm_server), intent(in) :: self
      character(:), allocatable :: text
      text = from_c(c_error_hint(self%handle))
      if (.not. counts(self%error_message())) return
      if (len(text) > 0) text = text//"; "
      text = text//"the message counts nodes, cells and rows from 0: add 1"
   end function

   ! Whether a message has the number of a node, a cell or a row.
   pure function counts(message) result(found)
      character(*), intent(in) :: message
      logical :: found
      character(6), parameter :: words(4) = [character(6) :: " node", " nodes", " cell", " row"]
      integer :: word, digit
      found = any([((index(" "//message, trim(words(word))//" "//achar(iachar("0") + digit)) > 0, &
                     digit = 0, 9), word = 1, size(words))])
   end function

   ! A number of the details: "best", "fraction", "row"; NaN if the details have no such number.
   function server_error_detail(self, path) result(number)
      class(mm_server), intent(in) :: self
      character(*), intent(in) :: path
      real(c_double) :: number
      number = c_report_number(c_error_details(self%handle), ended(path))
   end function

   subroutine server_clear_error(self)
      class(mm_server), intent(in) :: self
      call c_clear_error(self%handle)
   end subroutine

   ! End the connections; free or close the server's sessions before.
   subroutine server_free(self)
      class(mm_server), intent(inout) :: self
      call c_context_free(self%handle)
      self%handle = c_null_ptr
   end subroutine

   ! --- a mesh and how it is moved -----------------------------------------------------------------------------------

   subroutine session_create(self, server)
      class(mm_session), intent(inout) :: self
      type(mm_server), intent(in) :: server
      self%handle = c_session_new(server%handle)
   end subroutine

   ! Free the session; call it before the server is freed.
   subroutine session_free(self)
      class(mm_session), intent(inout) :: self
      call c_session_free(self%handle)
      self%handle = c_null_ptr
      call forget(self)
   end subroutine

   subroutine forget(self)
      type(mm_session), intent(inout) :: self
      type(kept), pointer :: next
      do while (associated(self%copies))
         next => self%copies%next
         deallocate (self%copies)
         self%copies => next
      end do
   end subroutine

   subroutine keep_more(self)
      type(mm_session), intent(inout) :: self
      type(kept), pointer :: more
      allocate (more)
      more%next => self%copies
      self%copies => more
   end subroutine

   ! (dimension, nodes), mesh length unit
   subroutine session_points(self, points)
      class(mm_session), intent(inout) :: self
      real(c_double), intent(in) :: points(:, :)
      integer(c_int) :: ignored
      call keep_more(self)
      allocate (self%copies%numbers, source=points)
      ignored = c_points(self%handle, size(points, 1, c_int), size(points, 2, c_size_t), first_number(self%copies))
   end subroutine

   function first_number(copy) result(address)
      type(kept), intent(in), target :: copy
      type(c_ptr) :: address
      address = c_loc(copy%numbers)
   end function

   function first_index(copy) result(address)
      type(kept), intent(in), target :: copy
      type(c_ptr) :: address
      address = c_loc(copy%indices)
   end function

   ! Number of nodes of a cell; 0 for an unknown type
   function nodes_of(type) result(count)
      character(*), intent(in) :: type
      integer :: count
      select case (type)
      case ("line"); count = 2
      case ("triangle"); count = 3
      case ("quad", "tetra"); count = 4
      case ("pyramid"); count = 5
      case ("wedge"); count = 6
      case ("hexahedron"); count = 8
      case default; count = 0
      end select
   end function

   subroutine session_cells_64(self, type, nodes)
      class(mm_session), intent(inout) :: self
      character(*), intent(in) :: type
      integer(c_int64_t), intent(in) :: nodes(:, :)
      integer(c_int) :: ignored
      if (size(nodes, 1) /= nodes_of(type)) then ! the C library would read behind the array; this call makes the error
         ignored = c_cells(self%handle, ended(type), 1_c_size_t, c_null_ptr)
         return
      end if
      call keep_more(self)
      allocate (self%copies%indices, source=reshape(nodes, [size(nodes)]) - 1)
      ignored = c_cells(self%handle, ended(type), size(nodes, 2, c_size_t), first_index(self%copies))
   end subroutine

   ! (nodes of the type, cells), in VTK's node order; a wedge in Gmsh's node order
   subroutine session_cells_32(self, type, nodes)
      class(mm_session), intent(inout) :: self
      character(*), intent(in) :: type
      integer(c_int32_t), intent(in) :: nodes(:, :)
      call session_cells_64(self, type, int(nodes, c_int64_t))
   end subroutine

   subroutine session_patch_64(self, name, role, nodes)
      class(mm_session), intent(inout) :: self
      character(*), intent(in) :: name, role
      integer(c_int64_t), intent(in) :: nodes(:)
      integer(c_int) :: ignored
      call keep_more(self)
      allocate (self%copies%indices, source=nodes - 1)
      ignored = c_patch(self%handle, ended(name), ended(role), size(nodes, 1, c_size_t), first_index(self%copies))
   end subroutine

   ! Roles: moving, fixed, slip, symmetry, periodic
   subroutine session_patch_32(self, name, role, nodes)
      class(mm_session), intent(inout) :: self
      character(*), intent(in) :: name, role
      integer(c_int32_t), intent(in) :: nodes(:)
      call session_patch_64(self, name, role, int(nodes, c_int64_t))
   end subroutine

   subroutine session_ids_64(self, ids)
      class(mm_session), intent(inout) :: self
      integer(c_int64_t), intent(in) :: ids(:)
      integer(c_int) :: ignored
      if (size(ids, 1, c_size_t) /= c_node_count(self%handle)) then
         ignored = c_global_ids(self%handle, c_null_ptr)
         return
      end if
      call keep_more(self)
      allocate (self%copies%indices, source=ids)
      ignored = c_global_ids(self%handle, first_index(self%copies))
   end subroutine

   ! The number of each node in the whole mesh, sent without a change
   subroutine session_ids_32(self, ids)
      class(mm_session), intent(inout) :: self
      integer(c_int32_t), intent(in) :: ids(:)
      call session_ids_64(self, int(ids, c_int64_t))
   end subroutine

   subroutine session_set_number(self, key, value)
      class(mm_session), intent(inout) :: self
      character(*), intent(in) :: key
      real(c_double), intent(in) :: value
      integer(c_int) :: ignored
      ignored = c_set_number(self%handle, ended(key), value)
   end subroutine

   subroutine session_set_integer(self, key, value)
      class(mm_session), intent(inout) :: self
      character(*), intent(in) :: key
      integer(c_int32_t), intent(in) :: value
      integer(c_int) :: ignored
      ignored = c_set_integer(self%handle, ended(key), int(value, c_int64_t))
   end subroutine

   subroutine session_set_flag(self, key, value)
      class(mm_session), intent(inout) :: self
      character(*), intent(in) :: key
      logical, intent(in) :: value
      integer(c_int) :: ignored
      ignored = c_set_flag(self%handle, ended(key), merge(1_c_int, 0_c_int, value))
   end subroutine

   subroutine session_set_text(self, key, value)
      class(mm_session), intent(inout) :: self
      character(*), intent(in) :: key, value
      integer(c_int) :: ignored
      ignored = c_set_text(self%handle, ended(key), ended(value))
   end subroutine

   subroutine session_label(self, label)
      class(mm_session), intent(inout) :: self
      character(*), intent(in) :: label
      integer(c_int) :: ignored
      ignored = c_set_label(self%handle, ended(label))
   end subroutine

   subroutine session_durability(self, durability)
      class(mm_session), intent(inout) :: self
      character(*), intent(in) :: durability
      integer(c_int) :: ignored
      ignored = c_set_durability(self%handle, ended(durability))
   end subroutine

   ! The side that moves the nodes and computes the quality: "server" or "client"
   subroutine session_evaluation(self, evaluation)
      class(mm_session), intent(inout) :: self
      character(*), intent(in) :: evaluation
      integer(c_int) :: ignored
      ignored = c_set_evaluation(self%handle, ended(evaluation))
   end subroutine

   ! The additional report of each move from now on: "faces" (the mesh as a finite-volume code sees it), "headroom" (the
   ! number of further steps of this kind that the mesh admits), "swept", or ""
   subroutine session_report(self, report)
      class(mm_session), intent(inout) :: self
      character(*), intent(in) :: report
      integer(c_int) :: ignored
      ignored = c_set_report(self%handle, ended(report))
   end subroutine

   ! Seconds after which the server gives up computing a move, from now on; 0: never
   subroutine session_compute_limit(self, seconds)
      class(mm_session), intent(inout) :: self
      real(c_double), intent(in) :: seconds
      integer(c_int) :: ignored
      ignored = c_set_compute_limit(self%handle, seconds)
   end subroutine

   ! The last step of the run, which each commit sends from now on; 0: unknown
   subroutine session_final_step(self, step)
      class(mm_session), intent(inout) :: self
      integer, intent(in) :: step
      integer(c_int) :: ignored
      ignored = c_set_final_step(self%handle, int(step, c_int64_t))
   end subroutine

   ! Before open: the time of the mesh as it is uploaded, seconds, and the scheme whose earlier levels each commit stores:
   ! "" (none), "bdf2" or "bossak"
   subroutine session_time_levels(self, start, scheme)
      class(mm_session), intent(inout) :: self
      real(c_double), intent(in) :: start
      character(*), intent(in) :: scheme
      integer(c_int) :: ignored
      ignored = c_set_time_levels(self%handle, start, ended(scheme))
   end subroutine

   ! The time at the end of the current step, for its moves and its commit
   subroutine session_time(self, time)
      class(mm_session), intent(inout) :: self
      real(c_double), intent(in) :: time
      integer(c_int) :: ignored
      ignored = c_set_time(self%handle, time)
   end subroutine

   ! The scheme of the velocities in the answers to moves, from now on: "" (none), "tangent", "bdf1", "bdf2" or
   ! "bossak"
   subroutine session_velocity_scheme(self, scheme)
      class(mm_session), intent(inout) :: self
      character(*), intent(in) :: scheme
      integer(c_int) :: ignored
      ignored = c_set_velocity(self%handle, ended(scheme))
   end subroutine

   ! With the scheme "tangent", and before its moves: velocities (dimension, moving nodes) of the moving nodes
   subroutine session_boundary_velocity(self, velocity)
      class(mm_session), intent(inout) :: self
      real(c_double), intent(in), contiguous :: velocity(:, :)
      integer(c_int) :: ignored
      ignored = c_set_boundary_velocity(self%handle, rows_of(self, velocity), velocity)
   end subroutine

   ! The faces of the report "swept", from now on: nodes (corners, faces) of each face, filled up with 0. In 3D
   ! anticlockwise as seen from the side that the normal points to; in 2D an edge has its normal on its right
   subroutine session_swept_faces(self, nodes)
      class(mm_session), intent(inout) :: self
      integer, intent(in) :: nodes(:, :)
      integer(c_int64_t), allocatable, target :: theirs(:, :)
      integer(c_int) :: ignored
      allocate (theirs(size(nodes, 1), size(nodes, 2) + 1), source=0_c_int64_t) ! one more: no face has an address, too
      theirs(:, :size(nodes, 2)) = nodes - 1
      ignored = c_set_swept_faces(self%handle, size(nodes, 2, c_size_t), size(nodes, 1, c_size_t), c_loc(theirs))
   end subroutine

   ! Let the report "swept" contain all faces of the cells again
   subroutine session_all_swept_faces(self)
      class(mm_session), intent(inout) :: self
      integer(c_int) :: ignored
      ignored = c_set_swept_faces(self%handle, 0_c_size_t, 1_c_size_t, c_null_ptr)
   end subroutine

   ! The unit of the headroom, from now on: "step"; "displacement", multiples of the whole displacement since the
   ! uploaded mesh; or "velocity", seconds of velocity()
   subroutine session_headroom_along(self, way)
      class(mm_session), intent(inout) :: self
      character(*), intent(in) :: way
      integer(c_int) :: ignored
      ignored = c_set_headroom_along(self%handle, ended(way))
   end subroutine

   ! Velocities (dimension, nodes) of all nodes in the last move; empty if no scheme was set
   function session_velocity(self) result(velocity)
      class(mm_session), intent(in) :: self
      real(c_double), allocatable :: velocity(:, :)
      real(c_double), pointer :: theirs(:, :)
      integer(c_size_t) :: count
      type(c_ptr) :: first
      first = c_velocity(self%handle, count)
      allocate (velocity(self%dimension(), count))
      if (count > 0) then
         call c_f_pointer(first, theirs, [int(self%dimension(), c_size_t), count])
         velocity = theirs
      end if
   end function

   ! Volumes that the swept faces sweep in the last move, with the report "swept"; for the faces of cells, positive
   ! outwards
   function session_swept(self) result(swept)
      class(mm_session), intent(in) :: self
      real(c_double), allocatable :: swept(:)
      real(c_double), pointer :: theirs(:)
      integer(c_size_t) :: count
      type(c_ptr) :: first
      first = c_swept(self%handle, count)
      allocate (swept(count))
      if (count > 0) then
         call c_f_pointer(first, theirs, [count])
         swept = theirs
      end if
   end function

   ! The number of the partition, as of an MPI rank: from 0 to partitions - 1
   subroutine session_partition(self, partition, partitions)
      class(mm_session), intent(inout) :: self
      integer, intent(in) :: partition, partitions
      integer(c_int) :: ignored
      ignored = c_set_partition(self%handle, int(partition, c_int), int(partitions, c_int))
   end subroutine

   ! --- opening ------------------------------------------------------------------------------------------------------

   subroutine session_open(self)
      class(mm_session), intent(inout) :: self
      integer(c_int) :: ignored
      ignored = c_open(self%handle)
   end subroutine

   subroutine session_join(self)
      class(mm_session), intent(inout) :: self
      integer(c_int) :: ignored
      ignored = c_join(self%handle)
   end subroutine

   ! Collective over the partitions
   subroutine session_build(self)
      class(mm_session), intent(inout) :: self
      if (c_build(self%handle) == 0) call forget(self)
   end subroutine

   subroutine session_resume(self)
      class(mm_session), intent(inout) :: self
      integer(c_int) :: ignored
      ignored = c_resume(self%handle)
   end subroutine

   ! The id and the token in hexadecimal digits: for MPI_Bcast to the other ranks. Keep it secret.
   function session_credentials(self) result(text)
      class(mm_session), intent(in) :: self
      character(id_size + 2*token_size) :: text
      integer(c_int8_t), pointer :: token(:)
      integer :: i
      text = ""
      if (.not. c_associated(c_token(self%handle))) return
      text = from_c(c_id(self%handle))
      call c_f_pointer(c_token(self%handle), token, [token_size])
      do i = 1, token_size
         write (text(id_size + 2*i - 1:id_size + 2*i), "(z2.2)") iand(int(token(i)), 255)
      end do
   end function

   subroutine session_use_credentials(self, credentials)
      class(mm_session), intent(inout) :: self
      character(*), intent(in) :: credentials
      integer(c_int8_t) :: token(token_size)
      integer :: i, byte, status
      integer(c_int) :: ignored
      token = 0
      do i = 1, merge(token_size, 0, len(credentials) == id_size + 2*token_size)
         read (credentials(id_size + 2*i - 1:id_size + 2*i), "(z2)", iostat=status) byte
         if (status /= 0) byte = 0
         token(i) = int(merge(byte - 256, byte, byte > 127), c_int8_t)
      end do
      ignored = c_set_credentials(self%handle, ended(credentials(:min(id_size, len(credentials)))), token)
   end subroutine

   subroutine session_save_credentials(self, path)
      class(mm_session), intent(in) :: self
      character(*), intent(in) :: path
      integer(c_int) :: ignored
      ignored = c_save_credentials(self%handle, ended(path))
   end subroutine

   subroutine session_load_credentials(self, path)
      class(mm_session), intent(inout) :: self
      character(*), intent(in) :: path
      integer(c_int) :: ignored
      ignored = c_load_credentials(self%handle, ended(path))
   end subroutine

   ! --- a time step --------------------------------------------------------------------------------------------------

   ! In: displacement (dimension, moving nodes). Out: displacement (dimension, nodes). Totals since the uploaded mesh
   ! unless frame is given
   subroutine session_move(self, displacement, answer, frame)
      class(mm_session), intent(inout) :: self
      real(c_double), intent(in), contiguous :: displacement(:, :)
      real(c_double), intent(inout), contiguous :: answer(:, :)
      integer(c_int), intent(in), optional :: frame
      integer(c_int) :: since, ignored
      since = mm_since_reference
      if (present(frame)) since = frame
      ignored = c_move(self%handle, since, rows_of(self, displacement), displacement, rows_of(self, answer), answer)
   end subroutine

   ! In: velocities (dimension, moving nodes) of the moving nodes. Out: velocities (dimension, nodes) of all nodes.
   ! Several vectors at once: (dimension, vectors, …). At the open trial, or at the committed state; nothing changes.
   subroutine tangent_one(self, velocity, answer)
      class(mm_session), intent(inout) :: self
      real(c_double), intent(in), contiguous :: velocity(:, :)
      real(c_double), intent(inout), contiguous :: answer(:, :)
      integer(c_int) :: ignored
      ignored = c_tangent(self%handle, 1_c_size_t, rows_of(self, velocity), velocity, rows_of(self, answer), answer)
   end subroutine

   subroutine tangent_all(self, velocity, answer)
      class(mm_session), intent(inout) :: self
      real(c_double), intent(in), contiguous :: velocity(:, :, :)
      real(c_double), intent(inout), contiguous :: answer(:, :, :)
      integer(c_int) :: ignored
      ignored = c_tangent(self%handle, size(velocity, 2, c_size_t), rows_of_all(self, velocity, size(velocity, 2)), &
                          velocity, rows_of_all(self, answer, size(velocity, 2)), answer)
   end subroutine

   ! In: weights (dimension, nodes), the derivative of an objective by the positions of all nodes. Out: its derivative
   ! by the positions of the moving nodes (dimension, moving nodes).
   subroutine cotangent_one(self, weights, answer)
      class(mm_session), intent(inout) :: self
      real(c_double), intent(in), contiguous :: weights(:, :)
      real(c_double), intent(inout), contiguous :: answer(:, :)
      integer(c_int) :: ignored
      ignored = c_cotangent(self%handle, 1_c_size_t, rows_of(self, weights), weights, rows_of(self, answer), answer)
   end subroutine

   subroutine cotangent_all(self, weights, answer)
      class(mm_session), intent(inout) :: self
      real(c_double), intent(in), contiguous :: weights(:, :, :)
      real(c_double), intent(inout), contiguous :: answer(:, :, :)
      integer(c_int) :: ignored
      ignored = c_cotangent(self%handle, size(weights, 2, c_size_t), rows_of_all(self, weights, size(weights, 2)), &
                            weights, rows_of_all(self, answer, size(weights, 2)), answer)
   end subroutine

   ! The C call for the given number of vectors.
   function rows_of_all(self, array, vectors) result(rows)
      type(mm_session), intent(in) :: self
      real(c_double), intent(in) :: array(:, :, :)
      integer, intent(in) :: vectors
      integer(c_size_t) :: rows
      rows = size(array, 3, c_size_t)
      if (size(array, 1) /= c_dimension(self%handle) .or. size(array, 2) /= vectors) rows = huge(rows)
   end function

   ! Number of rows for the C library; for an array of another dimension, a number that the library refuses.
   function rows_of(self, array) result(rows)
      type(mm_session), intent(in) :: self
      real(c_double), intent(in) :: array(:, :)
      integer(c_size_t) :: rows
      rows = size(array, 2, c_size_t)
      if (size(array, 1) /= c_dimension(self%handle)) rows = huge(rows)
   end function

   subroutine session_commit(self)
      class(mm_session), intent(inout) :: self
      integer(c_int) :: ignored
      ignored = c_commit(self%handle)
   end subroutine

   subroutine session_rollback(self)
      class(mm_session), intent(inout) :: self
      integer(c_int) :: ignored
      ignored = c_rollback(self%handle)
   end subroutine

   ! (dimension, nodes) coordinates of the committed or of the uploaded mesh
   subroutine session_fetch(self, points, which)
      class(mm_session), intent(inout) :: self
      real(c_double), intent(inout), contiguous :: points(:, :)
      integer(c_int), intent(in), optional :: which
      integer(c_int) :: since, ignored
      since = mm_since_committed
      if (present(which)) since = which
      ignored = c_fetch(self%handle, since, rows_of(self, points), points)
   end subroutine

   subroutine session_status(self)
      class(mm_session), intent(inout) :: self
      integer(c_int) :: ignored
      ignored = c_status(self%handle)
   end subroutine

   subroutine session_close(self, outcome)
      class(mm_session), intent(inout) :: self
      integer(c_int), intent(in), optional :: outcome
      integer(c_int) :: how, ignored
      how = mm_keep
      if (present(outcome)) how = outcome
      ignored = c_close(self%handle, how)
   end subroutine

   function session_dimension(self) result(dimension)
      class(mm_session), intent(in) :: self
      integer :: dimension
      dimension = c_dimension(self%handle)
   end function

   function session_node_count(self) result(count)
      class(mm_session), intent(in) :: self
      integer(c_int64_t) :: count
      count = c_node_count(self%handle)
   end function

   ! The nodes whose displacement move takes, ascending
   function session_moving_nodes(self) result(nodes)
      class(mm_session), intent(in) :: self
      integer(c_int64_t), allocatable :: nodes(:)
      integer(c_size_t) :: count
      type(c_ptr) :: first
      first = c_moving_nodes(self%handle, count)
      call from_zero(first, count, nodes)
   end function

   ! The nodes of a moving patch in the order of patch, after resume or join; none if json(mm_joined, "moving_patches")
   ! does not name it
   function session_patch_nodes(self, name) result(nodes)
      class(mm_session), intent(in) :: self
      character(*), intent(in) :: name
      integer(c_int64_t), allocatable :: nodes(:)
      integer(c_size_t) :: count
      type(c_ptr) :: first
      first = c_patch_nodes(self%handle, ended(name), count)
      call from_zero(first, count, nodes)
   end function

   ! Numbers that the library counts from 0, counted from 1
   subroutine from_zero(first, count, nodes)
      type(c_ptr), intent(in) :: first
      integer(c_size_t), intent(in) :: count
      integer(c_int64_t), allocatable, intent(out) :: nodes(:)
      integer(c_int64_t), pointer :: theirs(:)
      allocate (nodes(count))
      if (count > 0) then
         call c_f_pointer(first, theirs, [count])
         nodes = theirs + 1
      end if
   end subroutine

   function session_step(self) result(step)
      class(mm_session), intent(in) :: self
      integer(c_int64_t) :: step
      step = c_step(self%handle)
   end function

   function session_durable_step(self) result(step)
      class(mm_session), intent(in) :: self
      integer(c_int64_t) :: step
      step = c_durable_step(self%handle)
   end function

   function session_iteration(self) result(iteration)
      class(mm_session), intent(in) :: self
      integer(c_int64_t) :: iteration
      iteration = c_iteration(self%handle)
   end function

   function session_state(self) result(text)
      class(mm_session), intent(in) :: self
      character(:), allocatable :: text
      text = from_c(c_state(self%handle))
   end function

   ! --- reports ------------------------------------------------------------------------------------------------------

   function report_of(self, which) result(report)
      type(mm_session), intent(in) :: self
      integer, intent(in) :: which
      type(c_ptr) :: report
      select case (which)
      case (mm_joined); report = c_joined(self%handle)
      case (mm_built); report = c_built(self%handle)
      case (mm_moved); report = c_moved(self%handle)
      case (mm_committed); report = c_committed(self%handle)
      case (mm_status_report); report = c_status_report(self%handle)
      case default; report = c_null_ptr
      end select
   end function

   ! A value of the last reply of that kind, by path: number(mm_committed, "quality.metric.min"); NaN if the reply has
   ! no such value. The indices in a path count from 0, as in SPEC.md.
   function session_number(self, which, path) result(number)
      class(mm_session), intent(in) :: self
      integer, intent(in) :: which
      character(*), intent(in) :: path
      real(c_double) :: number
      number = c_report_number(report_of(self, which), ended(path))
   end function

   ! Anything of it as JSON
   function session_json(self, which, path) result(text)
      class(mm_session), intent(in) :: self
      integer, intent(in) :: which
      character(*), intent(in) :: path
      character(:), allocatable :: text
      text = json_of(report_of(self, which), path)
   end function

end module mesh_motion
