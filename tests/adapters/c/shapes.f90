! Arrays of which the C library would read more than there is, and one key without the other: prints the code of each.
program shapes
   use, intrinsic :: iso_fortran_env, only: int32, real64
   use mesh_motion
   implicit none
   type(mm_server) :: server
   type(mm_session) :: session
   integer(int32) :: cells(3, 2) = 1, ids(3) = 1
   real(real64) :: points(2, 4) = 0

   call server%connect("tcp://127.0.0.1:9", 0.1_real64, 0.1_real64) ! no server is there, and none is needed
   call server%clear_error()
   call session%create(server)
   call session%points(points)
   call session%cells("quad", cells)
   call report()
   call session%global_ids(ids)
   call report()
   call server%connect("tcp://127.0.0.1:9", 0.1_real64, 0.1_real64, secret_file="/nowhere/me.secret")
   call report()
   call server%connect("tcp://127.0.0.1:9", 0.1_real64, 0.1_real64, server_key="/nowhere/server.public")
   call report()
   call session%free()
   call server%free()

contains

   subroutine report()
      print "(a)", server%error_code()
      call server%clear_error()
   end subroutine

end program shapes
