! Velocities and swept volumes of two steps, as velocities.cpp has them: velocities ENDPOINT
program velocities
   use, intrinsic :: iso_fortran_env, only: real64
   use mesh_motion
   implicit none
   type(mm_server) :: server
   type(mm_session) :: session
   character(200) :: endpoint
   real(real64) :: answer(2, 4), row(2, 1)
   real(real64) :: velocity(2, 4)
   integer :: step
   call get_command_argument(1, endpoint)
   call server%connect(trim(endpoint))
   call session%create(server)
   call session%points(reshape([0, 0, 1, 0, 1, 1, 0, 1]*1.0_real64, [2, 4]))
   call session%cells("triangle", reshape([1, 2, 3, 1, 3, 4], [3, 2]))
   call session%patch("corner", "moving", [3])
   call session%patch("rest", "fixed", [1, 2, 4])
   call session%time_levels(1.0_real64, "bdf2")
   call session%open()
   call session%build()
   call session%report("swept")
   call session%velocity_scheme("bdf2")
   do step = 1, 2
      row = reshape([merge(0.1_real64, 0.3_real64, step == 1), 0.0_real64], [2, 1])
      call session%time(1.0_real64 + 0.25_real64*step)
      call session%move(row, answer, mm_since_reference)
      if (step == 2) then
         print "(es25.17)", session%velocity()
         print "(es25.17)", session%swept()
      end if
      call session%commit()
   end do
   row = reshape([0.0_real64, 0.1_real64], [2, 1])
   call session%time(1.75_real64)
   call session%velocity_scheme("tangent")
   call session%boundary_velocity(reshape([0.0_real64, -2.0_real64], [2, 1]))
   call session%swept_faces(reshape([2, 3, 3, 1], [2, 2]))
   call session%move(row, answer, mm_since_committed)
   velocity = session%velocity()
   print "(es25.17)", velocity(:, 3)
   print "(i0)", size(session%swept())
   print "(es25.17)", session%swept()
   call session%report("headroom")
   call session%headroom_along("velocity")
   call session%move(row, answer, mm_since_committed)
   print "(es25.17)", session%number(mm_moved, "headroom.inversion")
   call session%report("swept")
   call session%swept_faces(reshape([integer ::], [2, 0]))
   call session%move(row, answer, mm_since_committed)
   print "(i0)", size(session%swept())
   call session%all_swept_faces()
   call session%move(row, answer, mm_since_committed)
   print "(i0)", size(session%swept())
   if (server%failed()) print "(a)", server%error_message()
   call session%close(mm_discard)
   call session%free()
   call server%free()
end program
