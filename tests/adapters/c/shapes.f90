! shapes ENDPOINT: arrays of which the C library would read more than there is, one key without the other, and a node
! that the mesh does not have; prints the code of each, and the text of the last one.
program shapes
   use, intrinsic :: iso_fortran_env, only: int32, real64
   use mesh_motion
   implicit none
   type(mm_server) :: server
   type(mm_session) :: session
   integer(int32) :: cells(3, 2) = 1, ids(3) = 1
   real(real64) :: points(2, 4) = 0
   character(256) :: endpoint

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
   call get_command_argument(1, endpoint)
   call server%connect(trim(endpoint))
   call session%create(server)
   call session%points(points)
   call session%cells("triangle", reshape([1, 2, 3, 1, 3, 5], [3, 2]))
   call session%patch("all", "moving", [1, 2, 3, 4])
   call session%open()
   call session%build()
   print "(a)", server%error_message(), server%error_hint()
   call report()
   call session%close(mm_discard)
   call session%free()
   call server%free()

contains

   subroutine report()
      print "(a)", server%error_code()
      call server%clear_error()
   end subroutine

end program shapes
