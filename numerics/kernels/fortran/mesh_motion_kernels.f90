! mesh_motion_kernels.h in Fortran: the same calls; the header describes them.
!
!     use mesh_motion_kernels
!     type(c_ptr) :: field
!     failed = mesh_motion_interpolant_create("wendland-c2"//c_null_char, radius, 2_c_int64_t, centres, &
!                                             control_points, 2_c_int64_t, weights, field)
!
! Arrays have the axes of C in reverse order: points (d, n), weights (components, centres), nodes of cells
! (nodes of the type, cells), gradients (d, components, n). Nodes and cells count from 0. Text ends with
! c_null_char.
module mesh_motion_kernels
   use, intrinsic :: iso_c_binding
   implicit none
   public

   integer(c_int), parameter :: mesh_motion_ok = 0, mesh_motion_invalid_argument = 3, mesh_motion_out_of_memory = 8, &
                                mesh_motion_internal = 13
   integer(c_int), parameter :: mesh_motion_write = 0, mesh_motion_add = 1

   type, bind(c) :: mesh_motion_distribution
      real(c_double) :: minimum, mean, p1, p5, p50
   end type

   type, bind(c) :: mesh_motion_quality
      type(mesh_motion_distribution) :: size, skew, size_skew, metric
      integer(c_int64_t) :: inverted
   end type

   integer, parameter :: mesh_motion_bins = 2048, mesh_motion_worst = 10

   type, bind(c) :: mesh_motion_part
      integer(c_int64_t) :: cells, inverted, metrics
      type(c_ptr) :: names(4)
      real(c_double) :: sums(4), minima(4)
      integer(c_int64_t) :: worst_cells
      real(c_double) :: worst(9, mesh_motion_worst)
   end type

   type, bind(c) :: mesh_motion_facets
      integer(c_int64_t) :: count
      type(c_ptr) :: nodes
   end type

   type, bind(c) :: mesh_motion_region
      integer(c_int64_t) :: cells(7)
      type(c_ptr) :: names(7)
      integer(c_int64_t) :: nodes, corners
      type(c_ptr) :: indices, whole, rows
      real(c_double) :: least_skew, least_size
   end type

   interface
      integer(c_int) function mesh_motion_available_threads() bind(c)
         import
      end function

      integer(c_int) function mesh_motion_get_threads() bind(c)
         import
      end function

      integer(c_int) function mesh_motion_set_threads(threads) bind(c)
         import
         integer(c_int), value :: threads
      end function

      integer(c_int) function mesh_motion_interpolant_create(basis, support_radius, dimension, centres, &
                                                             control_points, components, weights, interpolant) bind(c)
         import
         character(kind=c_char), intent(in) :: basis(*)
         real(c_double), value :: support_radius
         integer(c_int64_t), value :: dimension, centres, components
         real(c_double), intent(in) :: control_points(*), weights(*)
         type(c_ptr), intent(out) :: interpolant
      end function

      integer(c_int) function mesh_motion_interpolant_create_on_grid(basis, support_radius, dimension, origin, &
                                                                     inverse_side, extent, shape, centres, &
                                                                     control_points, components, weights, &
                                                                     interpolant) bind(c)
         import
         character(kind=c_char), intent(in) :: basis(*)
         real(c_double), value :: support_radius, inverse_side, extent
         integer(c_int64_t), value :: dimension, centres, components
         real(c_double), intent(in) :: origin(3), control_points(*), weights(*)
         integer(c_int64_t), intent(in) :: shape(3)
         type(c_ptr), intent(out) :: interpolant
      end function

      subroutine mesh_motion_interpolant_free(interpolant) bind(c)
         import
         type(c_ptr), value :: interpolant
      end subroutine

      integer(c_int) function mesh_motion_interpolant_set_polynomial(interpolant, centre, scale, coefficients) bind(c)
         import
         type(c_ptr), value :: interpolant
         real(c_double), value :: scale
         real(c_double), intent(in) :: centre(*), coefficients(*)
      end function

      integer(c_int) function mesh_motion_interpolant_values(interpolant, n, points, mode, values) bind(c)
         import
         type(c_ptr), value :: interpolant
         integer(c_int64_t), value :: n
         real(c_double), intent(in) :: points(*)
         integer(c_int), value :: mode
         real(c_double), intent(inout) :: values(*)
      end function

      integer(c_int) function mesh_motion_interpolant_gradients(interpolant, n, points, mode, gradients) bind(c)
         import
         type(c_ptr), value :: interpolant
         integer(c_int64_t), value :: n
         real(c_double), intent(in) :: points(*)
         integer(c_int), value :: mode
         real(c_double), intent(inout) :: gradients(*)
      end function

      ! skipped: c_loc of an array of logical(c_bool), or c_null_ptr
      integer(c_int) function mesh_motion_near_create(interpolant, n, points, skipped, near) bind(c)
         import
         type(c_ptr), value :: interpolant, skipped
         integer(c_int64_t), value :: n
         real(c_double), intent(in) :: points(*)
         type(c_ptr), intent(out) :: near
      end function

      subroutine mesh_motion_near_free(near) bind(c)
         import
         type(c_ptr), value :: near
      end subroutine

      integer(c_int) function mesh_motion_near_add(near, components, weights, values) bind(c)
         import
         type(c_ptr), value :: near
         integer(c_int64_t), value :: components
         real(c_double), intent(in) :: weights(*)
         real(c_double), intent(inout) :: values(*)
      end function

      integer(c_int) function mesh_motion_spline_create(dimension, boxes, origin, inverse_spacing, cells, start, &
                                                        rows, components, coefficients, spline) bind(c)
         import
         integer(c_int64_t), value :: dimension, boxes, rows, components
         real(c_double), intent(in) :: origin(*), inverse_spacing(*), coefficients(*)
         integer(c_int64_t), intent(in) :: cells(*), start(*)
         type(c_ptr), intent(out) :: spline
      end function

      subroutine mesh_motion_spline_free(spline) bind(c)
         import
         type(c_ptr), value :: spline
      end subroutine

      integer(c_int) function mesh_motion_spline_values(spline, n, points, mode, values) bind(c)
         import
         type(c_ptr), value :: spline
         integer(c_int64_t), value :: n
         real(c_double), intent(in) :: points(*)
         integer(c_int), value :: mode
         real(c_double), intent(inout) :: values(*)
      end function

      integer(c_int) function mesh_motion_spline_counts(spline, n, points, components, weights, counts) bind(c)
         import
         type(c_ptr), value :: spline
         integer(c_int64_t), value :: n, components
         real(c_double), intent(in) :: points(*), weights(*)
         real(c_double), intent(inout) :: counts(*)
      end function

      integer(c_int) function mesh_motion_spline_gradients(spline, n, points, mode, gradients) bind(c)
         import
         type(c_ptr), value :: spline
         integer(c_int64_t), value :: n
         real(c_double), intent(in) :: points(*)
         integer(c_int), value :: mode
         real(c_double), intent(inout) :: gradients(*)
      end function

      integer(c_int) function mesh_motion_cells_create(cells) bind(c)
         import
         type(c_ptr), intent(out) :: cells
      end function

      integer(c_int) function mesh_motion_cells_add(cells, type, count, nodes) bind(c)
         import
         type(c_ptr), value :: cells
         character(kind=c_char), intent(in) :: type(*)
         integer(c_int64_t), value :: count
         integer(c_int64_t), intent(in) :: nodes(*)
      end function

      subroutine mesh_motion_cells_free(cells) bind(c)
         import
         type(c_ptr), value :: cells
      end subroutine

      integer(c_int) function mesh_motion_cell_sizes(cells, n, points, sizes) bind(c)
         import
         type(c_ptr), value :: cells
         integer(c_int64_t), value :: n
         real(c_double), intent(in) :: points(*)
         real(c_double), intent(out) :: sizes(*)
      end function

      integer(c_int) function mesh_motion_cell_quality(cells, n, points, reference_sizes, size, skew, inverted) bind(c)
         import
         type(c_ptr), value :: cells
         integer(c_int64_t), value :: n
         real(c_double), intent(in) :: points(*), reference_sizes(*)
         real(c_double), intent(out) :: size(*), skew(*)
         logical(c_bool), intent(out) :: inverted(*)
      end function

      ! skews_at_rest, points_at_rest: c_loc of an array, or c_null_ptr
      integer(c_int) function mesh_motion_lowest_cells(cells, n, points, reference_sizes, skews_at_rest, &
                                                       points_at_rest, metric, count, numbers, values, inverted) &
                                                       bind(c)
         import
         type(c_ptr), value :: cells, skews_at_rest, points_at_rest
         integer(c_int64_t), value :: n, count
         real(c_double), intent(in) :: points(*), reference_sizes(*)
         character(kind=c_char), intent(in) :: metric(*)
         integer(c_int64_t), intent(out) :: numbers(*)
         real(c_double), intent(out) :: values(*)
         integer(c_int64_t), intent(out) :: inverted
      end function

      integer(c_int) function mesh_motion_judge_cells(cells, n, points, reference_sizes, skews_at_rest, &
                                                      points_at_rest, metric, count, numbers, values, quality) &
                                                      bind(c)
         import
         type(c_ptr), value :: cells, skews_at_rest, points_at_rest
         integer(c_int64_t), value :: n, count
         real(c_double), intent(in) :: points(*), reference_sizes(*)
         character(kind=c_char), intent(in) :: metric(*)
         integer(c_int64_t), intent(out) :: numbers(*)
         real(c_double), intent(out) :: values(*)
         type(mesh_motion_quality), intent(out) :: quality
      end function

      integer(c_int) function mesh_motion_boundary_nodes(cells, n, boundary) bind(c)
         import
         type(c_ptr), value :: cells
         integer(c_int64_t), value :: n
         logical(c_bool), intent(out) :: boundary(*)
      end function

      ! facets: of type mesh_motion_facets, by c_f_pointer
      integer(c_int) function mesh_motion_facets_create(cells, facets) bind(c)
         import
         type(c_ptr), value :: cells
         type(c_ptr), intent(out) :: facets
      end function

      subroutine mesh_motion_facets_free(facets) bind(c)
         import
         type(c_ptr), value :: facets
      end subroutine

      integer(c_int) function mesh_motion_near_facets(d, n, points, count, facets, distance, near) bind(c)
         import
         integer(c_int64_t), value :: d, n, count
         real(c_double), intent(in) :: points(*), facets(*)
         real(c_double), value :: distance
         logical(c_bool), intent(out) :: near(*)
      end function

      integer(c_int) function mesh_motion_tally_create(cells, n, points, metric, tally) bind(c)
         import
         type(c_ptr), value :: cells
         integer(c_int64_t), value :: n
         real(c_double), intent(in) :: points(*)
         character(kind=c_char), intent(in) :: metric(*)
         type(c_ptr), intent(out) :: tally
      end function

      subroutine mesh_motion_tally_free(tally) bind(c)
         import
         type(c_ptr), value :: tally
      end subroutine

      integer(c_int) function mesh_motion_tally_judge(tally, n, points, part) bind(c)
         import
         type(c_ptr), value :: tally
         integer(c_int64_t), value :: n
         real(c_double), intent(in) :: points(*)
         type(mesh_motion_part), intent(out) :: part
      end function

      integer(c_int) function mesh_motion_tally_bin(tally, metric, divisions, way, counts, most, values, repeated, &
                                                    different) bind(c)
         import
         type(c_ptr), value :: tally
         character(kind=c_char), intent(in) :: metric(*)
         integer(c_int64_t), value :: divisions, most
         real(c_double), intent(in) :: way(*)
         integer(c_int64_t), intent(out) :: counts(*), repeated(*), different
         real(c_double), intent(out) :: values(*)
      end function

      ! region: of type mesh_motion_region, by c_f_pointer
      integer(c_int) function mesh_motion_region_create(tally, n, points, metric, below, rings, around, nodes, region) &
                                                        bind(c)
         import
         type(c_ptr), value :: tally
         character(kind=c_char), intent(in) :: metric(*)
         integer(c_int64_t), value :: n, rings, around
         real(c_double), intent(in) :: points(*)
         real(c_double), value :: below
         integer(c_int64_t), intent(in) :: nodes(*)
         type(c_ptr), intent(out) :: region
      end function

      ! region: of type mesh_motion_region, by c_f_pointer
      integer(c_int) function mesh_motion_cells_about_create(cells, n, marked, taken, region) bind(c)
         import
         type(c_ptr), value :: cells
         integer(c_int64_t), value :: n
         logical(c_bool), intent(in) :: marked(*)
         logical(c_bool), intent(inout) :: taken(*)
         type(c_ptr), intent(out) :: region
      end function

      subroutine mesh_motion_region_free(region) bind(c)
         import
         type(c_ptr), value :: region
      end subroutine
   end interface

contains

   ! The error message of the last failed call of this thread.
   function mesh_motion_kernels_error() result(message)
      character(:), allocatable :: message
      interface
         type(c_ptr) function c_error() bind(c, name="mesh_motion_kernels_error")
            import
         end function
      end interface
      character(kind=c_char), pointer :: text(:)
      integer :: length
      call c_f_pointer(c_error(), text, [512])
      length = findloc(text == c_null_char, .true., 1) - 1
      allocate (character(length) :: message)
      if (length > 0) message = transfer(text(:length), message)
   end function

end module mesh_motion_kernels
