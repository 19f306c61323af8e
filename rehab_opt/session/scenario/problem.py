"""What a problem file of `system = "scenario"` may say, and what each key means."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from rehab_opt.control.gate import Mode
from rehab_opt.plants.force_robot import RobotModel
from rehab_opt.plants.intention import LONGER, Aims
from rehab_opt.plants.simulated_person import FASTEST_LINE, Person
from rehab_opt.session.arm_keys import ArmInPlane, OneRange
from rehab_opt.session.plant import HandPlant
from rehab_opt.session.scenario.trials import Law
from rehab_opt.session.schema import (
    Length,
    Once,
    PlanarPlacement,
    Problem,
    RecordingSection,
    Section,
    SolverName,
    refusal,
)

__all__ = ["REACHES", "THERAPY", "RobotSection", "ScenarioProblem"]

THERAPY: tuple[Mode, ...] = ("stretch", "assist", "resist")
"""Modes that go beyond the comfortable workspace, to one place; in others a path is followed, or places are held."""
REACHES: tuple[Mode, ...] = ("assist", "resist")
"""Modes that are over when the end of the reference is reached."""
LEARNT: tuple[Mode, ...] = ("stretch", "assist")
"""Modes whose field may be learnt: what resists would be the opposite of what was shown."""

Point = Annotated[list[Length], Field(min_length=2, max_length=2)]
Seconds = Annotated[float, Field(ge=0.1, le=600)]
Width = Annotated[float, Field(ge=1, le=1000)]
MAX_TICKS = 2_000_000
"""Of all trials: each tick is kept."""


class ScenarioArm(ArmInPlane):
    """Whose arm, with the range that is comfortable and the one that can be helped."""

    comfortable: OneRange = "restricted"
    """W_c: `"restricted"` (Table I) or `"figure_3"` (its caption), or a table of the eight joints."""
    reachable: OneRange = "regular"
    """W_r, likewise."""


class DemonstrationsSection(Section):
    """What a therapist showed: movements recorded by the robot, with the forces on the hand."""

    files: Annotated[list[Annotated[str, Field(min_length=1)]], Field(min_length=1, max_length=200), Once]
    """What a robot recorded while a therapist led the hand: each a `.csv` with `t_s,x_m,y_m,fx_N,fy_N`, force on the
    hand, in the robot's frame."""


class TaskSection(Section):
    """What is to be done."""

    demonstrations: DemonstrationsSection | None = None
    """S, k1 and D are learnt from them (`stretch`, `assist`); the path is their mean, or the one given beside them."""
    points_m: Annotated[list[Point], Field(min_length=1, max_length=1000)] | None = None
    """Corners of the path, or the points to be held, in the frame of the shoulder; this or a recording."""
    recording: RecordingSection | None = None
    """Which movement."""
    placement: PlanarPlacement | None = None
    """Where it lies."""
    record_rate_hz: float = Field(default=100.0, ge=1, le=1000)
    """To which a recording is resampled."""
    start_m: Point | None = None
    """Where the hand is before it goes to the line; required in `stretch`."""
    mapped: bool = True
    """In `follow` and `hold`: the path lies in W_r and is mapped into W_c by the safe rule; false: it lies in W_c."""
    movement_s: Seconds = 5.0
    """Of the intended motion; in `hold` from point to point."""
    rest_s: float = Field(default=5.0, ge=0, le=600)
    """At its end."""
    dwell_s: Seconds = 1.5
    """At each point to be held."""
    within_mm: float = Field(default=5.0, gt=0, le=100)
    """Nearer is on the target; a reach is over after 0.5 s there below 20 mm/s."""
    trials: int = Field(default=4, ge=1, le=1000)
    """The same trial has the same moods under every law."""
    seed: int = Field(default=0, ge=0, le=2**31)
    """Of the moods."""

    @model_validator(mode="after")
    def the_path_is_said_once(self) -> Self:
        """Refuse none or two of them."""
        if self.recording is None and self.points_m is None and self.demonstrations is None:
            raise refusal("points_m", None, "points, a recording with its placement, or demonstrations")
        if self.recording is not None and self.points_m is not None:
            raise refusal("points_m", self.points_m, "no points where a recording is given")
        if (self.recording is None) != (self.placement is None):
            raise refusal("placement", self.placement, "recording and placement together")
        return self


class FieldSection(Section):
    """The force field: S, k1 or what it comes from, sigma, D; of one that is learnt only the sigmas to choose from."""

    stiffness_N_m: float | None = Field(default=None, gt=0, le=1e5)
    """S; required where nothing is learnt."""
    width_mm: Width | None = None
    """sigma; required where nothing is learnt."""
    widths_mm: Annotated[list[Width], Field(min_length=1, max_length=20), Once] | None = None
    """sigmas to choose from, by the error on what is held out (every fifth demonstration, or the last); then no other
    key of `field`."""
    drag_N_m: float = Field(default=0.0, ge=0, le=1e5)
    """k1 of Eq. (21), not in `resist` and `hold`."""
    resistance_N: float = Field(default=0.0, ge=0, le=1e4)
    """Against the motion, at the end of the path; required in `resist`."""
    damping_Ns_m: float = Field(default=0.0, ge=0, le=1e4)
    """D."""


class AssistanceSection(Section):
    """The bounds of the force."""

    force_limit_N: float = Field(default=30.0, gt=0, le=1000)
    """Largest force; this and what follows as in `Assistance`, of both sides with a helper."""
    slew_limit_N_s: float = Field(default=2500.0, gt=0, le=1e5)
    """Largest change of the force."""
    growth_limit_N_s: float = Field(default=200.0, gt=0, le=1e5)
    """Largest growth of a force that was not felt of late."""
    energy_budget_J: float = Field(default=20.0, gt=0, le=1e4)
    """Of the tank."""
    speed_cap_m_s: float = Field(default=1.0, gt=0, lt=10)
    """A faster hand is a fault."""
    onset_mm: float = Field(default=0.0, ge=0, le=1000)
    """Over which a therapy's force grows beyond W_c; zero is Eq. (23)."""


class RobotSection(Section):
    """The simulated robot: see `RobotModel`."""

    mass_kg: float = Field(default=RobotModel.mass, gt=0, le=100)
    """In every direction."""
    viscous_Ns_m: float = Field(default=RobotModel.viscous, ge=0, le=500)
    """Viscous friction."""
    coulomb_N: float = Field(default=RobotModel.coulomb, ge=0, le=100)
    """Dry friction."""
    gain: float = Field(default=RobotModel.gain, ge=0, le=10)
    """Proportional gain of the force loop."""
    integral_per_s: float = Field(default=RobotModel.integral, ge=0, le=1000)
    """Its integral gain."""
    sensor_noise_N: float = Field(default=RobotModel.noise, ge=0, le=10)
    """Standard deviation of the force sensor, per axis."""
    motor_limit_N: float = Field(default=RobotModel.motor_limit, gt=0, le=1000)
    """Of each axis."""
    lower_m: Point = Field(default=[-10.0, -10.0])
    """Stops."""
    upper_m: Point = Field(default=[10.0, 10.0])
    """Stops."""

    @model_validator(mode="after")
    def stops_are_in_order(self) -> Self:
        """Refuse a robot that can go nowhere."""
        if not all(low < high for low, high in zip(self.lower_m, self.upper_m, strict=True)):
            raise refusal("upper_m", self.upper_m, f"above robot.lower_m = {self.lower_m} in both coordinates")
        return self


class PersonSection(Section):
    """The simulated person: see `Person`."""

    hand_mass_kg: float = Field(default=Person.hand_mass, gt=0, le=20)
    """What moves with the hand."""
    stiffness_N_m: float = Field(default=Person.stiffness, ge=0, le=5000)
    """K, towards what is meant."""
    damping_Ns_m: float = Field(default=Person.damping, ge=0, le=500)
    """B."""
    persistence_per_s: float = Field(default=Person.persistence, ge=0, le=100)
    """How fast the effort grows: by this times K times the distance that is left, a second."""
    strength_N: float = Field(default=Person.strength, ge=0, le=1000)
    """Largest voluntary force within W_c."""
    weak_strength_N: float = Field(default=Person.weak_strength, ge=0, le=1000)
    """The same far outside."""
    fades_over_mm: float = Field(default=1e3 * Person.fades_over, gt=0, le=1000)
    """Over which the strength falls beyond the boundary of W_c."""
    passive_stiffness_N_m: float = Field(default=Person.passive_stiffness, ge=0, le=5000)
    """Of the pull back to the nearest point of W_c, outside it."""
    passive_damping_Ns_m: float = Field(default=Person.passive_damping, ge=0, le=500)
    """Everywhere."""
    wander_mm: float = Field(default=1e3 * Person.wander, ge=0, le=100)
    """Of where the hand is thought to be meant: standard deviation of each coordinate."""
    wander_s: float = Field(default=Person.wander_time, ge=0.01, le=60)
    """T of its autocorrelation (1 + t / T) exp(-t / T)."""
    tremor_N: float = Field(default=Person.tremor, ge=0, le=50)
    """Root mean square of the vector's length."""
    tremor_hz: float = Field(default=Person.tremor_hz, gt=0, le=30)
    """Centre of three lines."""
    spasms_per_s: float = Field(default=Person.spasm_rate, ge=0, le=10)
    """How often."""
    spasm_N: float = Field(default=Person.spasm_force, ge=0, le=100)
    """Mean peak."""
    spasm_s: float = Field(default=Person.spasm_time, gt=0, le=5)
    """Mean length."""
    aims: Aims = Person.aims
    """By the "clock", to where the hand should be by now; or along the "path", ahead of where the person sees it."""
    ahead_mm: float = Field(default=1e3 * Person.ahead, gt=0, le=100)
    """How far ahead at most, for "path"."""


class HelperSection(Section):
    """Who does the task along with the participant in the laws "together" and "delayed": see `Bilateral`."""

    delay_s: float = Field(default=0.1, gt=0, le=5)
    """Of messages, one way, in the law `delayed`."""
    stiffness_N_m: float = Field(default=400.0, gt=0, le=1e5)
    """Of the spring that draws the participant's hand."""
    damping_Ns_m: float = Field(default=20.0, ge=0, le=1e4)
    """Of that spring."""
    hand_damping_Ns_m: float = Field(default=2.0, ge=0, le=1e4)
    """Felt by the helper's hand."""
    exchange_per_s: float = Field(default=5.0, ge=0, le=1000)
    """Rate at which the tanks exchange energy."""
    wander_mm: float = Field(default=2.0, ge=0, le=100)
    """Standard deviation of where the helper's hand is meant to be."""


class RunSection(Section):
    """How it is run."""

    rate_hz: float = Field(default=1000.0, ge=20, le=5000)
    """Ticks a second of robot, person and law."""
    laws: Annotated[list[Law], Field(min_length=1), Once] = Field(default=["unassisted", "assisted", "published"])
    """Side by side; `together` and `delayed` with a mapped path in `follow`."""
    solver: SolverName | None = None
    """By default `Assistance`'s; `--solver` replaces it."""


class ScenarioProblem(Problem):
    """One of the five scenarios."""

    system: Literal["scenario"]
    mode: Mode
    """Scenarios 1 to 3 (`stretch`, `assist`, `resist`), 4 (`follow`), 5 (`hold`)."""
    arm: ScenarioArm
    """Whose arm."""
    task: TaskSection
    """What is to be done."""
    field: FieldSection
    """The force field."""
    assistance: AssistanceSection = AssistanceSection()
    """The bounds of the force."""
    helper: HelperSection = HelperSection()
    """Who does the task along with the participant."""
    robot: RobotSection = RobotSection()
    """The simulated robot."""
    person: PersonSection = PersonSection()
    """The simulated person."""
    run: RunSection = RunSection()
    """How it is run."""
    plant: HandPlant = HandPlant()
    """On which robot it runs: see the plant's keys."""

    @model_validator(mode="after")
    def the_field_is_given_or_learnt(self) -> Self:
        """Refuse numbers beside demonstrations, and none without them."""
        said = self.field
        if self.task.demonstrations is None:
            for key in ("stiffness_N_m", "width_mm"):
                if getattr(said, key) is None:
                    raise refusal(f"field.{key}", None, "this key, or task.demonstrations to learn it from")
            if said.widths_mm is not None:
                raise refusal("field.widths_mm", said.widths_mm, "width_mm, where there are no task.demonstrations")
            return self
        if self.mode not in LEARNT:
            raise refusal("task.demonstrations", self.mode, f"no such key but for mode = {' or '.join(LEARNT)}")
        if said.widths_mm is None:
            raise refusal(
                "field.widths_mm", None, "widths, of which the one that held-out demonstrations prefer is taken"
            )
        for key in ("stiffness_N_m", "width_mm", "drag_N_m", "damping_Ns_m"):
            if key in said.model_fields_set:
                raise refusal(f"field.{key}", getattr(said, key), "no such key: it is learnt from task.demonstrations")
        return self

    @model_validator(mode="after")
    def keys_go_with_the_mode(self) -> Self:
        """Refuse what the mode would ignore."""
        task, drives = self.task, self.field
        if self.mode != "resist" and drives.resistance_N:
            raise refusal("field.resistance_N", drives.resistance_N, '0, but for mode = "resist"')
        if self.mode == "resist" and not drives.resistance_N:
            raise refusal("field.resistance_N", drives.resistance_N, "the force against the motion, at the target")
        if self.mode == "resist" and drives.drag_N_m:
            raise refusal("field.drag_N_m", drives.drag_N_m, "0: resistance is set by resistance_N")
        if self.mode == "hold" and drives.drag_N_m:
            raise refusal("field.drag_N_m", drives.drag_N_m, "0: a point has no way to be dragged along")
        if self.mode != "hold" and task.points_m is not None and len(task.points_m) < 2:
            raise refusal("task.points_m", task.points_m, "at least two points of a path")
        if self.mode == "hold" and task.points_m is None:
            raise refusal("task.points_m", None, "the points to be held")
        pairs = [law for law in self.run.laws if law in ("together", "delayed")]
        if pairs and not (self.mode == "follow" and task.mapped):
            raise refusal("run.laws", pairs[0], 'other laws, but for mode = "follow" and a mapped path')
        if self.person.aims == "path" and self.mode != "follow":
            raise refusal("person.aims", self.person.aims, '"clock", but for mode = "follow"')
        if task.start_m is not None and self.mode != "stretch":
            raise refusal("task.start_m", task.start_m, 'no such key but for mode = "stretch"')
        if task.start_m is None and self.mode == "stretch":
            raise refusal("task.start_m", None, "where the hand is before it goes to the line")
        return self

    @model_validator(mode="after")
    def ticks_suffice_and_fit(self) -> Self:
        """Refuse what a rate cannot show, and what no memory holds."""
        task, rate = self.task, self.run.rate_hz
        fastest = FASTEST_LINE * self.person.tremor_hz
        if self.person.tremor_N and not 2 * fastest < rate:
            raise refusal(
                "person.tremor_hz", self.person.tremor_hz, f"below {rate / 2 / FASTEST_LINE:.3g} at this rate"
            )
        seconds = task.movement_s + task.rest_s
        if self.mode == "hold":
            count = len(task.points_m or ())
            seconds = count * task.dwell_s + (count - 1) * task.movement_s
        ticks = seconds * rate * task.trials * len(self.run.laws) * (LONGER if self.person.aims == "path" else 1)
        if not ticks <= MAX_TICKS:
            told = f"at most {int(MAX_TICKS / (seconds * rate * len(self.run.laws)))}"
            if ticks > task.trials * MAX_TICKS:
                told = "shorter trials or a lower run.rate_hz"
            raise refusal("task.trials", task.trials, f"{told}: {ticks:.3g} ticks of all laws, {MAX_TICKS} fit")
        return self
