"""Keys of a problem file of `system = "scenario"`, with their meaning."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, Self

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

THERAPY: tuple[Mode, ...] = ("stretch", "assist", "resist")
"""Modes that leave the comfortable workspace for one goal; in the others a path is followed, or points are held."""
REACHES: tuple[Mode, ...] = ("assist", "resist")
"""Modes that end when the end of the reference is reached."""
LEARNT: tuple[Mode, ...] = ("stretch", "assist")
"""Modes whose field may be learnt; resistance would be the opposite of the demonstrations."""

Point = Annotated[list[Length], Field(min_length=2, max_length=2)]
Seconds = Annotated[float, Field(ge=0.1, le=600)]
Width = Annotated[float, Field(ge=1, le=1000)]
MAX_TICKS = 2_000_000
"""Largest number of ticks of all trials together, since all are kept in memory."""


class ScenarioArm(ArmInPlane):
    """The arm with its comfortable and its reachable range of motion."""

    comfortable: OneRange = "restricted"
    """Range of motion that defines W_c: `"restricted"` (Table I), `"figure_3"` (caption of Fig. 3), or a table of the
    eight joints."""
    reachable: OneRange = "regular"
    """Range of motion that defines W_r, in the same forms."""


class DemonstrationsSection(Section):
    """Demonstrations of a therapist: movements recorded by the robot, with the forces on the hand."""

    FILES: ClassVar = ("files",)
    files: Annotated[list[Annotated[str, Field(min_length=1)]], Field(min_length=1, max_length=200), Once]
    """Recordings of a robot while a therapist led the hand: each a `.csv` with `t_s,x_m,y_m,fx_N,fy_N`, force on the
    hand, in the robot's frame."""


class TaskSection(Section):
    """The participant's task."""

    demonstrations: DemonstrationsSection | None = None
    """Demonstrations from which S, k1 and D are learnt, in `stretch` and `assist`; the path is their mean, unless it is
    given."""
    points_m: Annotated[list[Point], Field(min_length=1, max_length=1000)] | None = None
    """Corners of the path, or the points to hold, in the frame of the shoulder; either this or a recording."""
    recording: RecordingSection | None = None
    """A recorded movement."""
    placement: PlanarPlacement | None = None
    """Placement of the recording."""
    record_rate_hz: float = Field(default=100.0, ge=1, le=1000)
    """Rate to which a recording is resampled."""
    start_m: Point | None = None
    """Position of the hand before it moves to the path; required in `stretch`."""
    mapped: bool = True
    """In `follow` and `hold`: if true, the path lies in W_r and is mapped into W_c by a verified map; if false, it lies
    in W_c."""
    movement_s: Seconds = 5.0
    """Duration of the intended motion; in `hold` from point to point."""
    rest_s: float = Field(default=5.0, ge=0, le=600)
    """Rest at the end of the motion."""
    dwell_s: Seconds = 1.5
    """Rest at each point to hold."""
    within_mm: float = Field(default=5.0, gt=0, le=100)
    """A hand within this distance is on the target; a reach ends when it has been there for 0.5 s below 20 mm/s."""
    trials: int = Field(default=4, ge=1, le=1000)
    """Number of trials; the person varies from trial to trial, equally for every controller."""
    seed: int = Field(default=0, ge=0, le=2**31)
    """Seed of the person's variability."""

    @model_validator(mode="after")
    def the_path_is_said_once(self) -> Self:
        """Refuse two paths or none."""
        if self.recording is None and self.points_m is None and self.demonstrations is None:
            raise refusal("points_m", None, "points, a recording with its placement, or demonstrations")
        if self.recording is not None and self.points_m is not None:
            raise refusal("points_m", self.points_m, "no points where a recording is given")
        if (self.recording is None) != (self.placement is None):
            raise refusal("placement", self.placement, "recording and placement together")
        return self


class FieldSection(Section):
    """The force field: S, sigma, D, and k1 or `resistance_N`; for a learnt field only the candidate sigmas."""

    stiffness_N_m: float | None = Field(default=None, gt=0, le=1e5)
    """Stiffness S; required unless the field is learnt."""
    width_mm: Width | None = None
    """Width sigma; required unless the field is learnt."""
    widths_mm: Annotated[list[Width], Field(min_length=1, max_length=20), Once] | None = None
    """Candidates for sigma, chosen by the error on held-out data (every fifth demonstration, or the last one); no other
    key of `field` is allowed then."""
    drag_N_m: float = Field(default=0.0, ge=0, le=1e5)
    """Gain k1 of Eq. (21); not allowed in `resist` and `hold`."""
    resistance_N: float = Field(default=0.0, ge=0, le=1e4)
    """Force against the motion at the end of the path; required in `resist`."""
    damping_Ns_m: float = Field(default=0.0, ge=0, le=1e4)
    """Damping D."""


class AssistanceSection(Section):
    """Bounds of the force."""

    force_limit_N: float = Field(default=30.0, gt=0, le=1000)
    """Largest force. This and the following keys are those of `Assistance`; with a helper they hold for both sides."""
    slew_limit_N_s: float = Field(default=2500.0, gt=0, le=1e5)
    """Largest rate of change of the force."""
    growth_limit_N_s: float = Field(default=200.0, gt=0, le=1e5)
    """Largest rate at which the force grows above its recent maximum."""
    energy_budget_J: float = Field(default=20.0, gt=0, le=1e4)
    """Energy of the tank."""
    speed_cap_m_s: float = Field(default=1.0, gt=0, lt=10)
    """Largest speed of the hand; a faster hand counts as a fault."""
    onset_mm: float = Field(default=0.0, ge=0, le=1000)
    """Distance outside W_c over which the force grows to its full value in therapy; zero gives Eq. (23)."""


class RobotSection(Section):
    """The simulated robot: see `RobotModel`."""

    mass_kg: float = Field(default=RobotModel.mass, gt=0, le=100)
    """Mass of the robot, the same in every direction."""
    viscous_Ns_m: float = Field(default=RobotModel.viscous, ge=0, le=500)
    """Viscous friction."""
    coulomb_N: float = Field(default=RobotModel.coulomb, ge=0, le=100)
    """Dry friction."""
    gain: float = Field(default=RobotModel.gain, ge=0, le=10)
    """Proportional gain of the force loop."""
    integral_per_s: float = Field(default=RobotModel.integral, ge=0, le=1000)
    """Integral gain of the force loop."""
    sensor_noise_N: float = Field(default=RobotModel.noise, ge=0, le=10)
    """Standard deviation of the force sensor's noise, for each axis."""
    motor_limit_N: float = Field(default=RobotModel.motor_limit, gt=0, le=1000)
    """Largest motor force of each axis."""
    lower_m: Point = Field(default=[-10.0, -10.0])
    """Lower mechanical stops."""
    upper_m: Point = Field(default=[10.0, 10.0])
    """Upper mechanical stops."""

    @model_validator(mode="after")
    def stops_are_in_order(self) -> Self:
        """Refuse an upper stop that is not above the lower one."""
        if not all(low < high for low, high in zip(self.lower_m, self.upper_m, strict=True)):
            raise refusal("upper_m", self.upper_m, f"above robot.lower_m = {self.lower_m} in both coordinates")
        return self


class PersonSection(Section):
    """The simulated person: see `Person`."""

    hand_mass_kg: float = Field(default=Person.hand_mass, gt=0, le=20)
    """Mass of the hand and the parts that move with it."""
    stiffness_N_m: float = Field(default=Person.stiffness, ge=0, le=5000)
    """Stiffness K towards the intended position."""
    damping_Ns_m: float = Field(default=Person.damping, ge=0, le=500)
    """Damping B."""
    persistence_per_s: float = Field(default=Person.persistence, ge=0, le=100)
    """Growth rate of the effort: in each second, the force grows by this value times K times the remaining distance."""
    strength_N: float = Field(default=Person.strength, ge=0, le=1000)
    """Largest voluntary force within W_c."""
    weak_strength_N: float = Field(default=Person.weak_strength, ge=0, le=1000)
    """Largest voluntary force far outside W_c."""
    fades_over_mm: float = Field(default=1e3 * Person.fades_over, gt=0, le=1000)
    """Distance beyond the boundary of W_c over which the strength decreases."""
    passive_stiffness_N_m: float = Field(default=Person.passive_stiffness, ge=0, le=5000)
    """Outside W_c: stiffness of the passive pull to the nearest point of W_c."""
    passive_damping_Ns_m: float = Field(default=Person.passive_damping, ge=0, le=500)
    """Passive damping, inside and outside W_c."""
    wander_mm: float = Field(default=1e3 * Person.wander, ge=0, le=100)
    """Standard deviation, per coordinate, of the error in the intended position."""
    wander_s: float = Field(default=Person.wander_time, ge=0.01, le=60)
    """Time constant T of that error's autocorrelation (1 + t / T) exp(-t / T)."""
    tremor_N: float = Field(default=Person.tremor, ge=0, le=50)
    """Root mean square of the tremor force."""
    tremor_hz: float = Field(default=Person.tremor_hz, gt=0, le=30)
    """Frequency of the tremor, which is the centre of its three spectral lines."""
    spasms_per_s: float = Field(default=Person.spasm_rate, ge=0, le=10)
    """Mean rate of spasms."""
    spasm_N: float = Field(default=Person.spasm_force, ge=0, le=100)
    """Mean peak force of a spasm."""
    spasm_s: float = Field(default=Person.spasm_time, gt=0, le=5)
    """Mean duration of a spasm."""
    aims: Aims = Person.aims
    """How the intended position moves: with "clock", it is the point that is due at this time; with "path", a point
    ahead
    of where the person sees the hand."""
    ahead_mm: float = Field(default=1e3 * Person.ahead, gt=0, le=100)
    """With "path": largest distance of the intended position ahead of the hand."""


class HelperSection(Section):
    """The person who helps the participant with the controllers "together" and "delayed": see `Bilateral`."""

    delay_s: float = Field(default=0.1, gt=0, le=5)
    """One-way delay of messages, for `delayed`."""
    stiffness_N_m: float = Field(default=400.0, gt=0, le=1e5)
    """Stiffness of the spring that pulls the participant's hand."""
    damping_Ns_m: float = Field(default=20.0, ge=0, le=1e4)
    """Damping of that spring."""
    hand_damping_Ns_m: float = Field(default=2.0, ge=0, le=1e4)
    """Damping that the helper's hand feels."""
    exchange_per_s: float = Field(default=5.0, ge=0, le=1000)
    """Rate at which the tanks exchange energy."""
    wander_mm: float = Field(default=2.0, ge=0, le=100)
    """Standard deviation of the error in the helper's intended position."""


class RunSection(Section):
    """The run."""

    rate_hz: float = Field(default=1000.0, ge=20, le=5000)
    """Ticks per second of robot, person and controller."""
    laws: Annotated[list[Law], Field(min_length=1), Once] = Field(default=["unassisted", "assisted", "published"])
    """Controllers to compare; `together` and `delayed` need a mapped path and `follow`."""
    solver: SolverName | None = None
    """Solver of the QP; default: `Assistance`'s; `--solver` overrides it."""


class ScenarioProblem(Problem):
    """One of the five scenarios."""

    system: Literal["scenario"]
    mode: Mode
    """Scenarios 1 to 3 (`stretch`, `assist`, `resist`), 4 (`follow`), 5 (`hold`)."""
    arm: ScenarioArm
    """The participant's arm."""
    task: TaskSection
    """The participant's task."""
    field: FieldSection
    """The force field."""
    assistance: AssistanceSection = AssistanceSection()
    """Bounds of the force."""
    helper: HelperSection = HelperSection()
    """The person who helps the participant."""
    robot: RobotSection = RobotSection()
    """The simulated robot."""
    person: PersonSection = PersonSection()
    """The simulated person."""
    run: RunSection = RunSection()
    """The run."""
    plant: HandPlant = HandPlant()
    """The plant, see the plant's keys."""

    @model_validator(mode="after")
    def the_field_is_given_or_learnt(self) -> Self:
        """Refuse a field with both parameters and demonstrations, and a field with neither."""
        said = self.field
        if self.task.demonstrations is None:
            for key in ("stiffness_N_m", "width_mm"):
                if getattr(said, key) is None:
                    raise refusal(f"field.{key}", None, "this key, or task.demonstrations to learn it from")
            if said.widths_mm is not None:
                raise refusal("field.widths_mm", said.widths_mm, "width_mm, where there are no task.demonstrations")
            return self
        if self.mode not in LEARNT:
            raise refusal("task.demonstrations", self.mode, f"no such key except for mode = {' or '.join(LEARNT)}")
        if said.widths_mm is None:
            raise refusal("field.widths_mm", None, "widths, from which held-out demonstrations select one")
        for key in ("stiffness_N_m", "width_mm", "drag_N_m", "damping_Ns_m"):
            if key in said.model_fields_set:
                raise refusal(f"field.{key}", getattr(said, key), "no such key: it is learnt from task.demonstrations")
        return self

    @model_validator(mode="after")
    def keys_go_with_the_mode(self) -> Self:
        """Refuse keys that the mode would ignore."""
        task, drives = self.task, self.field
        if self.mode != "resist" and drives.resistance_N:
            raise refusal("field.resistance_N", drives.resistance_N, '0, but for mode = "resist"')
        if self.mode == "resist" and not drives.resistance_N:
            raise refusal("field.resistance_N", drives.resistance_N, "the force against the motion, at the target")
        if self.mode == "resist" and drives.drag_N_m:
            raise refusal("field.drag_N_m", drives.drag_N_m, "0: resistance is set by resistance_N")
        if self.mode == "hold" and drives.drag_N_m:
            raise refusal("field.drag_N_m", drives.drag_N_m, "0: a point has no path to be dragged along")
        if self.mode != "hold" and task.points_m is not None and len(task.points_m) < 2:
            raise refusal("task.points_m", task.points_m, "at least two points of a path")
        if self.mode == "hold" and task.points_m is None:
            raise refusal("task.points_m", None, "the points to be held")
        pairs = [law for law in self.run.laws if law in ("together", "delayed")]
        if pairs and not (self.mode == "follow" and task.mapped):
            raise refusal("run.laws", pairs[0], 'other controllers, except for mode = "follow" and a mapped path')
        if self.person.aims == "path" and self.mode != "follow":
            raise refusal("person.aims", self.person.aims, '"clock", but for mode = "follow"')
        if task.start_m is not None and self.mode != "stretch":
            raise refusal("task.start_m", task.start_m, 'no such key except for mode = "stretch"')
        if task.start_m is None and self.mode == "stretch":
            raise refusal("task.start_m", None, "position of the hand before it moves to the line")
        return self

    @model_validator(mode="after")
    def ticks_suffice_and_fit(self) -> Self:
        """Refuse a rate that is too low for the motion, and a run too long for the memory."""
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
            raise refusal("task.trials", task.trials, f"{told}: {ticks:.3g} ticks of all controllers, {MAX_TICKS} fit")
        return self
