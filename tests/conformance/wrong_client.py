"""Our client's driver with one seeded fault: ``python wrong_client.py FAULT …``."""

import sys
from dataclasses import replace

from mesh_motion_client.conformance import main
from mesh_motion_client.connection import Connection
from mesh_motion_client.courier import Courier
from mesh_motion_protocol import codec
from mesh_motion_protocol.errors import ProtocolError
from mesh_motion_protocol.messages import Moved


def numbers_repeats_again():
    request = Courier._request

    def again(self, message, deadline):
        self._sequence += 1
        return request(self, replace(message, sequence=self._sequence), deadline)

    Courier._request = again


def takes_any_reply():
    receive = Connection._receive

    def blind(self, message, deadline, watch, memory):
        reply = receive(self, message, deadline, watch, memory)
        return replace(reply, client=message.client, sequence=message.sequence) if isinstance(reply, Moved) else reply

    Connection._receive = blind


def does_not_join_again():
    join = Courier.join

    def once(self, endpoint, epoch, seconds):
        if self._epoch:
            self._data, self._epoch = Connection(self._control.data_endpoint(endpoint)), epoch
            return None
        return join(self, endpoint, epoch, seconds)

    Courier.join = once


def resumes_when_fenced():
    Courier._check_unfenced = lambda self, probed: None


def does_not_repeat_the_trial():
    Courier._repeat_trial = lambda self, deadline: None


def refuses_unknown_fields():
    def strict(header, frames, message_bytes, decode=codec._decode):
        if "later" in header["fields"]:
            raise ProtocolError("a field of a later version", code="INVALID_ARGUMENT.HEADER")
        return decode(header, frames, message_bytes)

    codec._decode = strict


def does_not_probe():
    Courier._watch = lambda self: None


def takes_lost_steps_for_granted():
    request = Courier._request

    def trusting(self, step):
        self.step = step

    def renumbered(self, message, deadline):
        known = self.step
        if self._data is None:
            self._recover(deadline)
        return request(self, replace(message, step=self.step + 1) if self.step < known else message, deadline)

    Courier._take_step, Courier._request = trusting, renumbered


def sends_a_field_too_many():
    pack = codec.pack
    codec.pack = lambda header: pack(header | {"fields": header["fields"] | {"of_ours": 1}})


FAULTS = {
    fault.__name__.replace("_", "-"): fault
    for fault in (
        numbers_repeats_again,
        takes_any_reply,
        does_not_join_again,
        resumes_when_fenced,
        does_not_repeat_the_trial,
        refuses_unknown_fields,
        does_not_probe,
        takes_lost_steps_for_granted,
        sends_a_field_too_many,
    )
}

if __name__ == "__main__":
    FAULTS[sys.argv[1]]()
    sys.exit(main(sys.argv[2:]))
