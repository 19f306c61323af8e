"""What a problem file of `system = "scenario"` may say; `problems/README.md` says what each key means."""

from __future__ import annotations

from typing import Annotated, Literal, Self, get_args

from pydantic import Field, model_validator

from rehab_opt.control.gate import Mode
from rehab_opt.plants.force_robot import RobotModel
from rehab_opt.session.arm_keys import OneRange
from rehab_opt.session.plant.tables import HandPlant
from rehab_opt.session.scenario.simulated_person import FASTEST_LINE, Person
from rehab_opt.session.scenario.trial import Law
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
from rehab_opt.session.workspaces.sections import ArmInPlane

__all__ = ["REACHES", "THERAPY", "FieldSection", "PersonSection", "RobotSection", "ScenarioProblem", "TaskSection"]

THERAPY: tuple[Mode, ...] = ("stretch", "assist", "resist")
"""Modes that go beyond the comfortable workspace."""
REACHES: tuple[Mode, ...] = ("assist", "resist")
"""Modes that are over when the end of the reference is reached."""
LEARNT: tuple[Mode, ...] = ("stretch", "assist")
"""Modes whose field may be learnt: what resists would be the opposite of what was shown."""

Point = Annotated[list[Length], Field(min_length=2, max_length=2)]
Seconds = Annotated[float, Field(ge=0.1, le=600)]
Width = Annotated[float, Field(ge=1, le=1000)]
MOST_TICKS = 2_000_000
"""Of all trials: each tick is kept."""


class ScenarioArm(ArmInPlane):
    """Whose arm, with the range that is comfortable and the one that can be helped."""

    comfortable: OneRange = "restricted"
    reachable: OneRange = "regular"


class DemonstrationsSection(Section):
    """What a therapist showed: movements recorded by the robot, with the forces on the hand."""

    files: Annotated[list[Annotated[str, Field(min_length=1)]], Field(min_length=1, max_length=200), Once]


class TaskSection(Section):
    """What is to be done."""

    demonstrations: DemonstrationsSection | None = None
    points_m: Annotated[list[Point], Field(min_length=1, max_length=1000)] | None = None
    recording: RecordingSection | None = None
    placement: PlanarPlacement | None = None
    record_rate_hz: float = Field(default=100.0, ge=1, le=1000)
    start_m: Point | None = None
    mapped: bool = True
    movement_s: Seconds = 5.0
    rest_s: float = Field(default=5.0, ge=0, le=600)
    dwell_s: Seconds = 1.5
    within_mm: float = Field(default=5.0, gt=0, le=100)
    trials: int = Field(default=4, ge=1, le=1000)
    seed: int = Field(default=0, ge=0, le=2**31)

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
    width_mm: Width | None = None
    widths_mm: Annotated[list[Width], Field(min_length=1, max_length=20), Once] | None = None
    drag_N_m: float = Field(default=0.0, ge=0, le=1e5)
    resistance_N: float = Field(default=0.0, ge=0, le=1e4)
    damping_Ns_m: float = Field(default=0.0, ge=0, le=1e4)


class AssistanceSection(Section):
    """The bounds of the force."""

    force_limit_N: float = Field(default=30.0, gt=0, le=1000)
    slew_limit_N_s: float = Field(default=2500.0, gt=0, le=1e5)
    growth_limit_N_s: float = Field(default=200.0, gt=0, le=1e5)
    energy_budget_J: float = Field(default=20.0, gt=0, le=1e4)
    speed_cap_m_s: float = Field(default=1.0, gt=0, lt=10)
    onset_mm: float = Field(default=0.0, ge=0, le=1000)


class RobotSection(Section):
    """The simulated robot: see `RobotModel`."""

    mass_kg: float = Field(default=RobotModel.mass, gt=0, le=100)
    viscous_Ns_m: float = Field(default=RobotModel.viscous, ge=0, le=500)
    coulomb_N: float = Field(default=RobotModel.coulomb, ge=0, le=100)
    gain: float = Field(default=RobotModel.gain, ge=0, le=10)
    integral_per_s: float = Field(default=RobotModel.integral, ge=0, le=1000)
    sensor_noise_N: float = Field(default=RobotModel.noise, ge=0, le=10)
    motor_limit_N: float = Field(default=RobotModel.motor_limit, gt=0, le=1000)
    lower_m: Point = Field(default=[-10.0, -10.0])
    upper_m: Point = Field(default=[10.0, 10.0])

    @model_validator(mode="after")
    def stops_are_in_order(self) -> Self:
        """Refuse a robot that can go nowhere."""
        if not all(low < high for low, high in zip(self.lower_m, self.upper_m, strict=True)):
            raise refusal("upper_m", self.upper_m, f"above robot.lower_m = {self.lower_m} in both coordinates")
        return self


class PersonSection(Section):
    """The simulated person: see `Person`."""

    hand_mass_kg: float = Field(default=Person.hand_mass, gt=0, le=20)
    stiffness_N_m: float = Field(default=Person.stiffness, ge=0, le=5000)
    damping_Ns_m: float = Field(default=Person.damping, ge=0, le=500)
    persistence_per_s: float = Field(default=Person.persistence, ge=0, le=100)
    strength_N: float = Field(default=Person.strength, ge=0, le=1000)
    weak_strength_N: float = Field(default=Person.weak_strength, ge=0, le=1000)
    fades_over_mm: float = Field(default=1e3 * Person.fades_over, gt=0, le=1000)
    passive_stiffness_N_m: float = Field(default=Person.passive_stiffness, ge=0, le=5000)
    passive_damping_Ns_m: float = Field(default=Person.passive_damping, ge=0, le=500)
    wander_mm: float = Field(default=1e3 * Person.wander, ge=0, le=100)
    wander_s: float = Field(default=Person.wander_time, ge=0.01, le=60)
    tremor_N: float = Field(default=Person.tremor, ge=0, le=50)
    tremor_hz: float = Field(default=Person.tremor_hz, gt=0, le=30)
    spasms_per_s: float = Field(default=Person.spasm_rate, ge=0, le=10)
    spasm_N: float = Field(default=Person.spasm_force, ge=0, le=100)
    spasm_s: float = Field(default=Person.spasm_time, gt=0, le=5)


class HelperSection(Section):
    """Who does the task along with the participant in the laws "together" and "delayed": see `Bilateral`."""

    delay_s: float = Field(default=0.1, gt=0, le=5)
    stiffness_N_m: float = Field(default=400.0, gt=0, le=1e5)
    damping_Ns_m: float = Field(default=20.0, ge=0, le=1e4)
    hand_damping_Ns_m: float = Field(default=2.0, ge=0, le=1e4)
    exchange_per_s: float = Field(default=5.0, ge=0, le=1000)
    wander_mm: float = Field(default=2.0, ge=0, le=100)


class RunSection(Section):
    """How it is run."""

    rate_hz: float = Field(default=1000.0, ge=20, le=5000)
    laws: Annotated[list[Law], Field(min_length=1), Once] = Field(default=["unassisted", "assisted", "published"])
    solver: SolverName | None = None


class ScenarioProblem(Problem):
    """One of the five scenarios."""

    system: Literal["scenario"]
    mode: Mode
    arm: ScenarioArm
    task: TaskSection
    field: FieldSection
    assistance: AssistanceSection = AssistanceSection()
    helper: HelperSection = HelperSection()
    robot: RobotSection = RobotSection()
    person: PersonSection = PersonSection()
    run: RunSection = RunSection()
    plant: HandPlant = HandPlant()

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
        assert self.mode in get_args(Mode)
        task, drives = self.task, self.field
        if self.mode != "resist" and drives.resistance_N:
            raise refusal("field.resistance_N", drives.resistance_N, '0, but for mode = "resist"')
        if self.mode == "resist" and not drives.resistance_N:
            raise refusal("field.resistance_N", drives.resistance_N, "the force against the motion, at the target")
        if self.mode == "resist" and drives.drag_N_m:
            raise refusal("field.drag_N_m", drives.drag_N_m, "0: what resists is said by resistance_N")
        if self.mode == "hold" and drives.drag_N_m:
            raise refusal("field.drag_N_m", drives.drag_N_m, "0: a point has no way to be dragged along")
        if self.mode != "hold" and task.points_m is not None and len(task.points_m) < 2:
            raise refusal("task.points_m", task.points_m, "at least two points of a path")
        if self.mode == "hold" and task.points_m is None:
            raise refusal("task.points_m", None, "the points to be held")
        pairs = [law for law in self.run.laws if law in ("together", "delayed")]
        if pairs and not (self.mode == "follow" and task.mapped):
            raise refusal("run.laws", pairs[0], 'other laws, but for mode = "follow" and a mapped path')
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
        ticks = seconds * rate * task.trials * len(self.run.laws)
        if not ticks <= MOST_TICKS:
            told = f"at most {int(MOST_TICKS / (seconds * rate * len(self.run.laws)))}"
            if ticks > task.trials * MOST_TICKS:
                told = "shorter trials or a lower run.rate_hz"
            raise refusal("task.trials", task.trials, f"{told}: {ticks:.3g} ticks of all laws, {MOST_TICKS} fit")
        return self
