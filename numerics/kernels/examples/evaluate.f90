! A square turns inside a square, in this process: no server, no Python. The same as evaluate.c.
!
!     evaluate_f90 [POINTS]
!
! The displacement of the inner and of the outer square is interpolated by Wendland's C2 function, whose weights come
! from a small dense system. The nodes of the mesh between them move with the interpolant, and the cells are judged
! against themselves at rest. POINTS receives the final coordinates (float64, x and y of each node).
program evaluate
   use, intrinsic :: iso_fortran_env, only: real64, int64, error_unit
   use mesh_motion_kernels
   implicit none
   integer, parameter :: cells = 12, low = 4, high = 8, worst = 3
   real(real64), parameter :: radius = 0.8_real64
   integer(int64), parameter :: two = 2
   real(real64), allocatable :: points(:, :), centres(:, :), given(:, :), weights(:, :), moved(:, :), sizes(:)
   integer(int64), allocatable :: quads(:, :)
   type(c_ptr) :: field, mesh
   type(mesh_motion_quality) :: quality
   integer(int64) :: numbers(worst)
   real(real64) :: values(worst)
   character(256) :: file
   integer :: unit, s

   call make_mesh()
   call solve()

   call check(mesh_motion_cells_create(mesh))
   call check(mesh_motion_cells_add(mesh, "quad"//c_null_char, size(quads, 2, int64), quads))
   allocate (sizes(size(quads, 2)), moved(2, size(points, 2)))
   call check(mesh_motion_cell_sizes(mesh, size(points, 2, int64), points, sizes))

   call check(mesh_motion_interpolant_create("wendland-c2"//c_null_char, radius, two, size(centres, 2, int64), &
                                             centres, two, weights, field))
   moved = points
   call check(mesh_motion_interpolant_values(field, size(points, 2, int64), points, mesh_motion_write, moved))
   moved = moved + points

   call check(mesh_motion_judge_cells(mesh, size(points, 2, int64), moved, sizes, c_null_ptr, c_null_ptr, &
                                      "size-skew"//c_null_char, int(worst, int64), numbers, values, quality))
   print "('size-skew of ', i0, ' cells: minimum ', f8.6, ', mean ', f8.6, ', median ', f8.6, ', ', i0, ' inverted')", &
      size(quads, 2), quality%size_skew%minimum, quality%size_skew%mean, quality%size_skew%p50, quality%inverted
   do s = 1, worst
      print "('cell ', i0, ': ', f8.6)", numbers(s), values(s)
   end do
   call mesh_motion_interpolant_free(field)
   call mesh_motion_cells_free(mesh)

   call get_command_argument(1, file)
   if (file /= "") then
      open (newunit=unit, file=file, access="stream", form="unformatted", status="replace")
      write (unit) moved
      close (unit)
   end if

contains

   ! A call that must succeed.
   subroutine check(result)
      integer(c_int), intent(in) :: result
      if (result == mesh_motion_ok) return
      write (error_unit, "(a)") mesh_motion_kernels_error()
      stop 1
   end subroutine

   ! The unit square in cells x cells cells, without those of the inner square; the nodes of both squares are control
   ! points: the inner ones turn (cosine 0.8) and move, the outer ones stay. Nodes count from 0, as the library wants them.
   subroutine make_mesh()
      integer(int64) :: number(0:cells, 0:cells)
      real(real64) :: x(2)
      integer :: i, j
      logical :: inner
      allocate (points(2, 0), centres(2, 0), given(2, 0), quads(4, 0))
      do j = 0, cells
         do i = 0, cells
            if (i > low .and. i < high .and. j > low .and. j < high) cycle
            x = [real(i, real64)/cells, real(j, real64)/cells]
            number(i, j) = size(points, 2)
            points = reshape([points, x], [2, size(points, 2) + 1])
            inner = i >= low .and. i <= high .and. j >= low .and. j <= high
            if (.not. (inner .or. i == 0 .or. i == cells .or. j == 0 .or. j == cells)) cycle
            centres = reshape([centres, x], [2, size(centres, 2) + 1])
            x = x - 0.5_real64
            x = [-0.2_real64*x(1) - 0.6_real64*x(2), 0.6_real64*x(1) - 0.2_real64*x(2)] + [0.03_real64, 0.02_real64]
            given = reshape([given, merge(x, 0.0_real64*x, inner)], [2, size(centres, 2)])
         end do
      end do
      do j = 0, cells - 1
         do i = 0, cells - 1
            if (i >= low .and. i < high .and. j >= low .and. j < high) cycle
            quads = reshape([quads, number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)], &
                            [4, size(quads, 2) + 1])
         end do
      end do
   end subroutine

   ! Weights with which the interpolant meets the given displacements: Cholesky's L of the matrix, which is symmetric
   ! and positive definite, then L and its transpose are solved with. Column j of the matrix is the function around
   ! control point j alone, at all of them.
   subroutine solve()
      real(real64) :: matrix(size(centres, 2), size(centres, 2))
      type(c_ptr) :: single
      integer :: i, j, n
      n = size(centres, 2)
      do j = 1, n
         call check(mesh_motion_interpolant_create("wendland-c2"//c_null_char, radius, two, 1_int64, centres(:, j), &
                                                   1_int64, [1.0_real64], single))
         call check(mesh_motion_interpolant_values(single, int(n, int64), centres, mesh_motion_write, matrix(:, j)))
         call mesh_motion_interpolant_free(single)
      end do
      do i = 1, n
         do j = 1, i
            matrix(i, j) = matrix(i, j) - dot_product(matrix(i, :j - 1), matrix(j, :j - 1))
            matrix(i, j) = merge(sqrt(matrix(i, i)), matrix(i, j)/matrix(j, j), i == j)
         end do
      end do
      weights = given
      do i = 1, n
         weights(:, i) = (weights(:, i) - matmul(weights(:, :i - 1), matrix(i, :i - 1)))/matrix(i, i)
      end do
      do i = n, 1, -1
         weights(:, i) = (weights(:, i) - matmul(weights(:, i + 1:), matrix(i + 1:, i)))/matrix(i, i)
      end do
   end subroutine

end program evaluate
