"""The tiny motions are motions: built, valid, accepted; and an order ends them."""

from types import SimpleNamespace

from mesh_motion_server.numerics import motion
from mesh_motion_server.transport import warmup


def test_it_moves_a_mesh_in_2d_and_in_3d(monkeypatch):
    moved = []

    class Recorded(motion.MotionModel):
        def move(self, committed, targets, factors=None, *, sent=None):
            moved.append((committed.shape[1], super().move(committed, targets, factors).reached))

    monkeypatch.setattr(motion, "MotionModel", Recorded)
    warmup.warm_up("mesh_motion_server.numerics.motion", interrupted=lambda: False)
    assert moved == [(2, True), (2, True), (3, True), (3, True)]  # by two solvers


def test_an_order_ends_it(monkeypatch):
    model = SimpleNamespace(build=lambda *_: (_ for _ in ()).throw(AssertionError("it went on")))
    monkeypatch.setattr(motion, "MotionModel", model)
    warmup.warm_up("mesh_motion_server.numerics.motion", interrupted=lambda: True)


def test_numerics_without_a_model_need_no_warmth():
    warmup.warm_up("json", interrupted=lambda: False)
