"""A judge of the controllers that does not believe them: `python -m tests.judge`.

It imports nothing of `rehab_opt` but the public controllers and value types; kinematics, integration, geometry and
energy are its own, in plain numpy. Each module with `GUARANTEES` judges guarantees of docs/guarantees.md, and offers

    GUARANTEES  their ids on that page
    LEAST     situation -> least number of ticks in it, per 10^6 ticks, without which nothing is proven: `Verdict.asked`
    CI_TICKS  how many ticks a slice in CI takes
    SHARE     its part of a campaign's ticks beside 1.0 of the others (optional)
    run       (ticks, seed, only=None) -> Verdict, by `numbering.judging`; `only`: the number of one run of this seed

Loops record, numpy judges the whole run afterwards.
"""
