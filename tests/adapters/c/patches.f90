! patches ENDPOINT CREDENTIALS: the time and the moving patches of a resumed session whose mesh this program has not.
program patches
   use mesh_motion
   implicit none
   type(mm_server) :: server
   type(mm_session) :: session
   character(256) :: argument
   call get_command_argument(1, argument)
   call server%connect(trim(argument))
   call session%create(server)
   call get_command_argument(2, argument)
   call session%load_credentials(trim(argument))
   call session%resume()
   if (server%failed()) error stop 'not resumed'
   print '(g0)', session%number(mm_joined, 'time')
   print '(a, *(1x, i0))', 'wing', session%patch_nodes('wing') - 1
   print '(a, *(1x, i0))', 'flap', session%patch_nodes('flap') - 1
   print '(a, *(1x, i0))', 'wall', session%patch_nodes('wall') - 1
   call server%free()
end program patches
