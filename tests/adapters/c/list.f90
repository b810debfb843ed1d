! list ENDPOINT: the sessions of a server as JSON.
program list
   use mesh_motion
   implicit none
   type(mm_server) :: server
   character(256) :: endpoint
   call get_command_argument(1, endpoint)
   call server%connect(trim(endpoint))
   call server%list()
   print '(a)', server%listed('sessions')
   call server%list('ffffffffffffffffffffffffffffffff')
   if (server%listed('sessions') /= '[]' .or. server%failed()) error stop 'one after the last'
   call server%free()
end program list
