"""All checks, in the order of their run: a new check is a module with a ``CHECK``, and a line here."""

from tests.faults import (
    attacked_server,
    authorisation_matrix,
    conformance,
    decoder_fuzz,
    handler_fuzz,
    io_faults,
    isolation,
    journal_damage,
    kill_nine,
    many_sessions,
    named_failpoints,
    network_faults,
    numerical_input,
    own_ranks,
    power_loss,
    soak,
    state_machine,
)
from tests.faults.check import Check

#: By what they are about.
CHECKS: tuple[Check, ...] = (
    # what is stored
    power_loss.CHECK,
    io_faults.CHECK,
    journal_damage.CHECK,
    kill_nine.CHECK,
    named_failpoints.CHECK,
    state_machine.CHECK,
    # what comes in
    conformance.CHECK,
    decoder_fuzz.CHECK,
    handler_fuzz.CHECK,
    attacked_server.CHECK,
    authorisation_matrix.CHECK,
    network_faults.CHECK,
    own_ranks.CHECK,
    isolation.CHECK,
    numerical_input.CHECK,
    # how many, how long
    many_sessions.CHECK,
    soak.CHECK,
)
