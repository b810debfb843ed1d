"""The row of bad and extreme inputs in the table of what is proved."""

from tests.faults.bad_inputs import BAD_INPUTS, Verdicts, prove_bad_inputs
from tests.faults.check import Budget, Check, Result, require
from tests.faults.extreme_inputs import prove_extreme_inputs


def run(seed: int, budget: Budget) -> Result:
    """The whole table of bad inputs, in one round after the other with other places spoiled, then the extreme ones."""
    right = rounds = 0
    while not rounds or budget.admits(right):
        verdicts = prove_bad_inputs(seed + rounds)
        _require_none_wrong(verdicts)
        right, rounds = right + verdicts.right, rounds + 1
    extreme = prove_extreme_inputs()
    _require_none_wrong(extreme)
    got = f"{right} of {right}; {extreme.right} of {extreme.cases} extreme ones exact"
    return Result(got, passed=True, details={"refused": right, "rounds": rounds, "extreme": extreme.right})


def _require_none_wrong(verdicts: Verdicts) -> None:
    name, why = next(iter(verdicts.wrong.items()), ("", ""))
    require(
        not verdicts.wrong, f"{len(verdicts.wrong)} of {verdicts.cases} wrong with seed {verdicts.seed}: {name}: {why}"
    )


CHECK = Check(
    name="numbers",
    target="{count} bad inputs: due error, offender named, no trace",
    short=len(BAD_INPUTS),
    full=20 * len(BAD_INPUTS),
    seconds=12.0,
    run=run,
)
