"""The jobs of one run, the most important ones first, so that a run of limited time measures as much as possible.

A job's seconds are its time on two quiet cores with its mesh built; a job that would not end in time is omitted.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["PLANS", "Job"]


@dataclass(frozen=True)
class Job:
    """One measurement in a separate process.

    Attributes
    ----------
    kind : {"library", "wire", "truth", "correction", "derivative", "peer", "start"}
    name : str
        A case of :mod:`benchmarks.scale` (the first three kinds), of :mod:`benchmarks.correction` or of
        :mod:`benchmarks.peers`; the mesh that :mod:`benchmarks.start` opens, or :mod:`benchmarks.derivatives` moves.
    seconds : float
        Approximate time of the job.
    system : str
        Of a peer.
    """

    kind: str
    name: str
    seconds: float
    system: str = ""

    @property
    def text(self) -> str:
        """``wire M4-steady``."""
        return " ".join(word for word in (self.kind, self.name, self.system) if word)


def _library(kind: str, **seconds: float) -> list[Job]:
    return [Job("library", f"{mesh}-{kind}", s) for mesh, s in seconds.items()]


def _wire(kind: str, **seconds: float) -> list[Job]:
    return [Job("wire", f"{mesh}-{kind}", s) for mesh, s in seconds.items()]


def _truths(**seconds: float) -> list[Job]:
    return [Job("truth", f"{mesh}-large", s) for mesh, s in seconds.items()]


def _corrections(**seconds: float) -> list[Job]:
    return [Job("correction", name.replace("_", "-").replace("p", "."), s) for name, s in seconds.items()]


def _peers(case: str, **seconds: float) -> list[Job]:
    return [Job("peer", case, s, system.replace("_", "-")) for system, s in seconds.items()]


_SMALL = [
    *_library("steady", M3=6, M2=6, M1=5),
    Job("start", "M3", 15),
    *_wire("steady", M3=25),
    *_library("large", M3=6, M2=6),
    *_peers("M3-T3-1", ours_plain=7, dense_rbf=12, kratos_laplacian=8, openfoam_converged=9),
    *_truths(M3=8, M2=5),
    *_corrections(M3_0p28=10),
    *_library("steady", M6=5, W2=6, S2=6, W3=7, S3=7),
    *_library("large", M1=5, M6=5),
]

_FULL = [
    *_library("steady", M3=6, M4=16),
    *_wire("steady", M4=50, M3=25),
    Job("start", "M3", 25),
    *_library("steady", M5=80, M2=6, M7=16, M1=5, M6=5, W2=6, S2=6, W3=7, S3=7),
    *_library("large", M3=6, M4=16, M2=6, M7=16),
    *_truths(M3=8, M4=45, M2=5, M7=15),
    *_peers("M3-T3-1", dense_rbf=12, ours_plain=7, ours=8, ours_optimised=8, openfoam_converged=9, kratos_laplacian=8),
    *_corrections(M3_0p28=10, M4_0p25=35, M3_max=20, M2_max=20),
    Job("derivative", "M3", 8),
    Job("derivative", "M4", 40),
    *_wire("steady", M2=25, M7=40),
    *_peers("M2-T1-1", dense_rbf=8, ours_plain=7, ours=8, ours_optimised=8, openfoam_converged=15, kratos_laplacian=15),
    *_peers("M4-T3-1", ours_plain=20, kratos_laplacian=90),
    *_peers("M1-T1-20", dense_rbf=4, ours=5, ours_optimised=5, openfoam_converged=5, kratos_laplacian=6),
    *_peers("M3-T3-1", ours_maximum=20, scipy_rbf=25, openfoam_uncorrected=9, kratos_similarity=12),
    *_peers("M3-T3-1", openfoam=9, ours_served=20),
    *_peers("M3-T3-1", ours_one_scale=15),
    *_peers("M2-T1-1", ours_one_scale=10),
    *_peers("M2-T1-1", ours_maximum=15, openfoam_uncorrected=15, kratos_similarity=30, scipy_rbf=25, openfoam=15),
    *_peers("M1-T1-20", ours_maximum=5, openfoam_uncorrected=5, kratos_similarity=6, openfoam=5, scipy_rbf=4),
    *_corrections(M3_0p20=8, M4_0p20=20, M2_0p20=8),
    *_wire("steady", M5=150),
    *_library("large", M1=5, M6=5),
    *_corrections(H1_max=30),
    *_peers("M4-T3-1", openfoam_converged=120),
    *_wire("large", M3=25, M4=40),
    *_wire("steady", M1=20, M6=20),
    *_library("large", M5=80),
]

_DENSE = [Job("peer", "M4-T3-1", 280, "dense-rbf")]

PLANS: dict[str, list[Job]] = {"full": _FULL, "quick": _SMALL, "dense": [*_FULL[:2], *_DENSE, *_FULL[2:]]}
"""By name. "dense" adds M4's motion by the textbook's dense matrices: 5 GB and some minutes."""
