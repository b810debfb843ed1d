! Two tangents and two cotangents, as derivatives.cpp has them: derivatives ENDPOINT ROLE EVALUATION
program derivatives
   use, intrinsic :: iso_fortran_env, only: int64, real64
   use mesh_motion
   implicit none
   integer, parameter :: cells = 12, side = cells + 1
   type(mm_server) :: server
   type(mm_session) :: session
   character(200) :: endpoint, role, evaluation
   real(real64) :: points(2, side*side), weights(2, 2, side*side), answer(2, side*side), tangents(2, 2, side*side)
   real(real64) :: x, y, rows(2, side), velocities(2, 2, side), cotangents(2, 2, side)
   integer :: quads(4, cells*cells), left(side), walls(2*side), right(side), i, j, low, quad, wall
   integer(int64) :: moving(side)
   quad = 0
   wall = 0
   do j = 0, cells
      do i = 0, cells
         x = real(i, real64)/cells
         y = real(j, real64)/cells
         low = j*side + i + 1
         points(:, low) = [x, y]
         weights(:, :, low) = reshape([x, y, x*y, 1.0_real64], [2, 2])
         if (i == 0) then
            left(j + 1) = low
         else if (i == cells) then
            right(j + 1) = low
         else if (j == 0 .or. j == cells) then
            wall = wall + 1
            walls(wall) = low
         end if
         if (i < cells .and. j < cells) then
            quad = quad + 1
            quads(:, quad) = [low, low + 1, low + side + 1, low + side]
         end if
      end do
   end do
   call get_command_argument(1, endpoint)
   call get_command_argument(2, role)
   call get_command_argument(3, evaluation)
   call server%connect(trim(endpoint))
   call session%create(server)
   call session%points(points)
   call session%cells("quad", quads)
   call session%patch("left", "moving", left)
   call session%patch("walls", trim(role), walls(:wall))
   call session%patch("right", "fixed", right)
   call session%evaluation(trim(evaluation))
   call session%open()
   call session%build()
   moving = session%moving_nodes()
   do i = 1, side
      y = points(2, moving(i))
      rows(:, i) = [1.2_real64*y*(1.0_real64 - y), 0.0_real64]
      velocities(:, :, i) = reshape([y, 1.0_real64, 1.0_real64, y*y], [2, 2])
   end do
   call session%move(rows, answer)
   call session%tangent(velocities, tangents)
   call session%cotangent(weights, cotangents)
   print "(es25.17)", tangents
   print "(es25.17)", cotangents
   if (server%failed()) print "(a)", server%error_message()
   call session%close(mm_discard)
   call session%free()
   call server%free()
end program
