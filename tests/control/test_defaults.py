"""Numbers that stand for a setting that is left out."""

from tests.judge.documented_defaults import defaults
from tests.judge.verdict import Verdict


def test_every_default_of_a_controller_is_the_documented_number() -> None:
    verdict = Verdict("defaults", seed=0)
    defaults(verdict)
    assert not verdict.broken, "\n".join(each.numbers for each in verdict.broken)
