"""Wrong clients: our client with one seeded fault, by name, and the case that must detect it."""

from dataclasses import replace

from mesh_motion_client.connection import Connection
from mesh_motion_client.courier import Courier
from mesh_motion_protocol import codec
from mesh_motion_protocol.errors import ProtocolError
from mesh_motion_protocol.messages import Moved
from seeded_faults import listed_in, nothing

WRONG_CLIENTS = []
fault = listed_in(WRONG_CLIENTS)


@fault("10.1-MOVE-repeated-by-the-caller", "11.1-connection-cut-after-MOVE-was-executed")
def numbers_repeats_again(patch):
    request = Courier._request

    def again(self, message, deadline):
        self._sequence += 1
        return request(self, replace(message, sequence=self._sequence), deadline)

    patch.setattr(Courier, "_request", again)


@fault("4-replies-to-others-come-first")
def takes_any_reply(patch):
    receive = Connection._receive

    def blind(self, message, deadline, watch, memory):
        reply = receive(self, message, deadline, watch, memory)
        return replace(reply, client=message.client, sequence=message.sequence) if isinstance(reply, Moved) else reply

    patch.setattr(Connection, "_receive", blind)


@fault("11.1-connection-cut-after-COMMIT-was-executed")
def does_not_join_again(patch):
    join = Courier.join

    def once(self, endpoint, epoch, seconds):
        if self._epoch:
            self._data, self._epoch = Connection(self._control.data_endpoint(endpoint)), epoch
            return None
        return join(self, endpoint, epoch, seconds)

    patch.setattr(Courier, "join", once)


@fault("11.3-fenced-while-the-connection-was-broken")
def resumes_when_fenced(patch):
    patch.setattr(Courier, "_check_unfenced", nothing)


@fault("11.4-worker-died-before-COMMIT-was-executed")
def does_not_repeat_the_trial(patch):
    patch.setattr(Courier, "_repeat_trial", nothing)


@fault("4-unknown-fields-in-every-reply")
def refuses_unknown_fields(patch):
    def strict(header, frames, message_bytes, decode=codec._decode):
        if "later" in header["fields"]:
            raise ProtocolError("a field of a later version", code="INVALID_ARGUMENT.HEADER")
        return decode(header, frames, message_bytes)

    patch.setattr(codec, "_decode", strict)


@fault("11.2-PROBE-while-MOVE-is-computed")
def does_not_probe(patch):
    patch.setattr(Courier, "_watch", nothing)


@fault("21.5-committed-steps-did-not-survive")
def takes_lost_steps_for_granted(patch):
    request = Courier._request

    def trusting(self, step):
        self.step = step

    def renumbered(self, message, deadline):
        known = self.step
        if self._data is None:
            self._recover(deadline)
        return request(self, replace(message, step=self.step + 1) if self.step < known else message, deadline)

    patch.setattr(Courier, "_take_step", trusting)
    patch.setattr(Courier, "_request", renumbered)


@fault("7-undisturbed")
def sends_a_field_too_many(patch):
    pack = codec.pack
    patch.setattr(codec, "pack", lambda header: pack(header | {"fields": header["fields"] | {"of_ours": 1}}))
