"""The rows themselves: The rows: ``python -m tests.faults``, or ``pytest -m faults``; they take minutes, and run only
on such a request.
"""

import pytest

from tests.faults import table
from tests.faults.check import Check
from tests.faults.proof import Proof


@pytest.mark.faults
@pytest.mark.timeout(0)  # each row has a limit of its own, which counts it as failed, and the next one runs
@pytest.mark.filterwarnings("default")  # numbers at the end of the range are what some rows send
@pytest.mark.parametrize("row", table.CHECKS, ids=lambda row: row.name)
def test_row(row: Check, proof: Proof) -> None:
    outcome = proof.run(row)
    if outcome["traceback"]:
        pytest.fail(outcome["traceback"], pytrace=False)
    assert outcome["passed"], f"{outcome['got']}; the target: {outcome['target']}"
