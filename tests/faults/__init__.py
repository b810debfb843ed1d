"""Checks that the server keeps its promises: ``python -m tests.faults``.

:mod:`~tests.faults.check` defines a check, :mod:`~tests.faults.table` lists all checks, and pytest runs them
(test_rows.py; :mod:`~tests.faults.proof` prints and writes the results). Each check has its own module; the other tests
run the same code with small counts, and with seeded bugs that it must find (seeded/sitecustomize.py has those of a
server in separate processes).

A check that is not named here consists of one module. Parts of the other checks, and modules that they share::

    session state        state_machine.py plays actions.py and accidents.py: ranks.py asks, played.py compares with
                         session_model.py (session_table.py; reply_book.py, expected.py)
    the disk             model_files.py loses power, damages and fails; kill_nine.py kills killed_process.py
    a fault anywhere     named_failpoints.py: persistent_user.py asks a failing_server.py
    the network          network_faults.py, own_ranks.py: network_driver.py goes through faulty_network.py
    attacks              attacked_server.py: attacks.py on bytes of zmtp_stream.py
    neighbours           isolation.py: neighbours.py harm sessions
    bad messages         decoder_fuzz.py, handler_fuzz.py: mutations.py of golden vectors and of valid_requests.py;
                         allowed_codes.py
    bad input            numerical_input.py judges the rows of inputs/
    rights               authorisation_matrix.py: expected_rights.py, hidden_sessions.py
    many, and long       many_sessions.py, soak.py (soak_client.py)

    a server             server_process.py as installed, stand_in_server.py without numerics (stand_in_service.py),
                         in_process.py in this process (in_process_parts.py)
    a client             the product's, through network_driver.py; holder.py, written from SPEC.md alone, on wire.py
    a mesh and a model   stand_in.py, client_mesh.py
    the right result     driver.py asks a session without a socket, undisturbed.py
    of the machine       processes.py, waiting.py
"""
