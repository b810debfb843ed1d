! A block turns and moves inside a square: a coupling code in Fortran, from the mesh to the committed steps.
!
!     block_f90 tcp://127.0.0.1:7440 [POINTS]
!
! The mesh is made here, of quadrilaterals around a hole, as a flow solver has it. Each time step has three coupling
! iterations, of which the last one is committed. Prints the quality of each step; POINTS receives the final coordinates
! (float64, x and y of each node).
program block
   use, intrinsic :: iso_fortran_env, only: real64, int64, error_unit
   use mesh_motion
   implicit none
   integer, parameter :: cells = 16, low = 6, high = 10, steps = 4, iterations = 3
   real(real64), allocatable :: points(:, :), rows(:, :), displacement(:, :)
   integer, allocatable :: quads(:, :), moving(:), walls(:)
   integer(int64), allocatable :: nodes(:)
   type(mm_server) :: server
   type(mm_session) :: session
   character(256) :: endpoint, file
   real(real64) :: share, quality, lowest
   integer :: step, iteration, unit

   call get_command_argument(1, endpoint)
   call get_command_argument(2, file)
   call make_mesh()
   call server%connect(endpoint)
   call session%create(server)
   call session%points(points)
   call session%cells("quad", quads)
   call session%patch("block", "moving", moving)
   call session%patch("walls", "fixed", walls)
   call session%set("support_radius", 0.5_real64)
   call session%open()
   call session%build()
   call session%final_step(steps) ! who watches the session then sees when it ends
   ! errors are sticky: after the first one the calls below do nothing, and one check at the end of a step is enough
   nodes = session%moving_nodes()
   allocate (rows(2, size(nodes)), displacement(2, size(points, 2)))
   lowest = 1
   do step = 1, steps
      do iteration = 1, iterations
         share = (step - 1 + real(iteration, real64)/iterations)/steps
         call displace(share)
         call session%move(rows, displacement, mm_since_reference)
         ! here the flow solver takes points + displacement, and gives loads to the structure
      end do
      call session%commit()
      if (server%failed()) exit
      quality = session%number(mm_committed, "quality.metric.min")
      lowest = min(lowest, quality)
      print "('step ', i0, ': quality at least ', f8.6)", step, quality
   end do
   call session%fetch(displacement)
   call session%close(mm_discard)
   if (server%failed()) then
      write (error_unit, "(a, ': ', a, /, a)") server%error_code(), server%error_message(), server%error_hint()
      stop 1
   end if
   call session%free()
   call server%free()
   print "('minimum quality ', f8.6)", lowest
   if (file /= "") then
      open (newunit=unit, file=file, access="stream", form="unformatted", status="replace")
      write (unit) displacement
      close (unit)
   end if

contains

   ! The unit square in cells x cells cells, without those of the block; nodes count from 1.
   subroutine make_mesh()
      integer :: number(0:cells, 0:cells), i, j, count
      allocate (points(2, 0), quads(4, 0), moving(0), walls(0))
      count = 0
      do j = 0, cells
         do i = 0, cells
            if (i > low .and. i < high .and. j > low .and. j < high) cycle
            count = count + 1
            number(i, j) = count
            points = reshape([points, real(i, real64)/cells, real(j, real64)/cells], [2, count])
            if (i >= low .and. i <= high .and. j >= low .and. j <= high) moving = [moving, count]
            if (i == 0 .or. i == cells .or. j == 0 .or. j == cells) walls = [walls, count]
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

   ! The boundary's position, which a structural solver would give: a share of a rotation (cosine 0.96) and of a
   ! translation.
   subroutine displace(share)
      real(real64), intent(in) :: share
      real(real64) :: x, y
      integer :: k
      do k = 1, size(nodes)
         x = points(1, nodes(k)) - 0.5_real64
         y = points(2, nodes(k)) - 0.5_real64
         rows(1, k) = share*(-0.04_real64*x - 0.28_real64*y + 0.1_real64)
         rows(2, k) = share*(0.28_real64*x - 0.04_real64*y + 0.05_real64)
      end do
   end subroutine

end program block
