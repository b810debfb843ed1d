! The driver program of the Fortran module for the conformance suite; protocol/conformance/README.md has the contract.
program driver
   use, intrinsic :: iso_fortran_env, only: real64, output_unit
   use mesh_motion
   implicit none
   type(mm_server) :: server
   type(mm_session) :: session
   logical :: is_open = .false.
   character(1024) :: endpoint, scenario, word
   character(32) :: verb, called = "hello"
   character(:), allocatable :: line
   real(real64) :: seconds
   integer :: moves = 0, blank

   call read_options()
   do while (scenario /= "")
      blank = index(scenario, " ")
      verb = scenario(:blank - 1)
      scenario = adjustl(scenario(blank:))
      if (verb /= "again") then
         called = verb
         if (verb(:4) == "move") moves = moves + 1
      end if
      line = '{"verb": "'//trim(verb)//'"'
      call perform(called)
      if (server%failed()) then
         line = line//', "ok": false, "code": "'//server%error_code()//'"}'
      else
         line = line//', "ok": true}'
      end if
      print "(a)", line
      flush (output_unit)
      call server%clear_error()
   end do
   call session%free()
   call server%free()
   deallocate (line)

contains

   subroutine read_options()
      integer :: i
      do i = 1, command_argument_count() - 1, 2
         call get_command_argument(i, word)
         select case (word)
         case ("--endpoint"); call get_command_argument(i + 1, endpoint)
         case ("--scenario"); call get_command_argument(i + 1, scenario)
         case ("--timeout")
            call get_command_argument(i + 1, word)
            read (word, *) seconds
         end select
      end do
   end subroutine

   subroutine perform(verb)
      character(*), intent(in) :: verb
      select case (verb)
      case ("hello")
         call server%connect(endpoint, seconds, seconds)
         line = line//', "version": '//server%welcome("version")
      case ("open"); call open_session()
      case ("move"); call move(mm_since_committed)
      case ("move-reference"); call move(mm_since_reference)
      case ("tangent"); call tangent()
      case ("cotangent"); call cotangent()
      case ("commit")
         call session%commit()
         line = line//', "step": '//decimal(int(session%step()))//', "digest": '//session%json(mm_committed, "digest")
      case ("rollback"); call session%rollback()
      case ("status")
         call session%status()
         line = line//', "state": '//session%json(mm_status_report, "state")
         line = line//', "step": '//session%json(mm_status_report, "step")
      case ("points"); call fetch()
      case ("resume"); call resume()
      case ("close"); call session%close()
      case ("discard"); call session%close(mm_discard)
      end select
   end subroutine

   ! The mesh of the contract; nodes count from 1 in Fortran.
   subroutine open_session()
      if (.not. is_open) then
         call session%create(server)
         call session%points(reshape([0._real64, 0._real64, 1._real64, 0._real64, 1._real64, 1._real64, 0._real64, &
                                      1._real64], [2, 4]))
         call session%cells("triangle", reshape([1, 2, 3, 1, 3, 4], [3, 2]))
         call session%patch("left", "moving", [1, 4])
         call session%patch("right", "fixed", [2, 3])
         call session%open()
         is_open = .true.
      end if
      call session%build()
      line = line//', "moving_nodes": '//list(real(session%moving_nodes() - 1, real64))
   end subroutine

   subroutine move(frame)
      integer, intent(in) :: frame
      real(real64) :: rows(2, 2), answer(2, 4)
      rows(1, :) = moves/8._real64
      rows(2, :) = moves/16._real64
      answer = 0
      call session%move(rows, answer, frame)
      line = line//', "iteration": '//decimal(int(session%iteration()))
      line = line//', "displacement": '//list(reshape(answer, [8]))
   end subroutine

   subroutine fetch()
      real(real64) :: answer(2, 4)
      answer = 0
      call session%fetch(answer)
      line = line//', "points": '//list(reshape(answer, [8]))
   end subroutine

   subroutine tangent()
      real(real64) :: velocity(2, 2), answer(2, 4)
      velocity(1, :) = 0.25_real64
      velocity(2, :) = 0.125_real64
      answer = 0
      call session%tangent(velocity, answer)
      line = line//', "velocity": '//list(reshape(answer, [8]))
   end subroutine

   subroutine cotangent()
      real(real64) :: weights(2, 1, 4), answer(2, 1, 2)
      integer :: i
      weights = reshape([(i/8._real64, i=1, 8)], [2, 1, 4])
      answer = 0
      call session%cotangent(weights, answer)
      line = line//', "weights": '//list(reshape(answer, [4]))
   end subroutine

   ! Resume with a new session object, as another program would.
   subroutine resume()
      type(mm_session) :: again
      call again%create(server)
      call again%use_credentials(session%credentials())
      call again%resume()
      call session%free()
      session = again
      line = line//', "step": '//decimal(int(session%step()))
   end subroutine

   function decimal(number) result(text)
      integer, intent(in) :: number
      character(:), allocatable :: text
      character(16) :: buffer
      write (buffer, "(i0)") number
      text = trim(buffer)
   end function

   function list(numbers) result(text)
      real(real64), intent(in) :: numbers(:)
      character(:), allocatable :: text
      character(32) :: buffer
      integer :: i
      text = "["
      do i = 1, size(numbers)
         write (buffer, "(es24.16e3)") numbers(i)
         text = text//trim(adjustl(buffer))
         if (i < size(numbers)) text = text//", "
      end do
      text = text//"]"
   end function

end program driver
