//! From the plan to recordings and sealed answers.

use crate::{
    axis::{self, AxisRig},
    ball::{self, BallRig},
    baseline,
    cases::{Extent, Machine, Planned, Plant, Twist, plan as plan_cases},
    catalogue::{self, Place, Sizing},
    draw::Draw,
    gantry::{BELT_PER_TORQUE, BELT_PER_TURN, Gantry},
    observe::{Observation, observe},
    plan::{Excitation, Plan, plan},
    record::{Label, write_axis, write_ball, write_gantry},
    step::{Commands, Phases, simulate},
    truth::{Answers, Case, Class, Parameter, PlantedEffect, Rig, SCHEMA_VERSION},
    visibility::{Floors, Visibility, floors, visibility},
};
use anyhow::{Context as _, Result};
use klasktron::recording::Split;
use std::{
    collections::BTreeMap,
    f64::consts::TAU,
    fs,
    path::Path,
    sync::{
        Mutex,
        atomic::{AtomicUsize, Ordering},
    },
    thread,
};

/// Length of a gantry session and of an axis session (s).
const GANTRY_SECONDS: f64 = 30.0;
const AXIS_SECONDS: f64 = 20.0;
/// Halvings of a planted effect's size, in the logarithm of its range.
const HALVINGS: usize = 8;
/// Share of its size that an effect must keep in what is recorded.
const LEAST_SHOWN: f64 = 0.5;
/// Speeds of the two sessions.
const PACES: [f64; 2] = [1.0, 0.82];

/// What `generate` is asked for.
pub(crate) struct Request<'a> {
    pub(crate) out: &'a Path,
    pub(crate) seed: u64,
    pub(crate) extent: Extent,
    pub(crate) jobs: usize,
}

/// Writes all recordings, `answers.json` and `baselines.json` into the folder.
pub(crate) fn generate(request: &Request<'_>) -> Result<Answers> {
    fs::create_dir_all(request.out).context("create the folder of the cases")?;
    let cases = plan_cases(request.seed, request.extent);
    let mut used: Vec<Machine> = cases.iter().map(|case| case.machine).collect();
    used.sort_unstable();
    used.dedup();
    let bases: Vec<(String, Planned)> =
        used.iter().map(|machine| (base_name(*machine), base_case(*machine))).collect();
    let known: Known = run_all(request, &bases, &Known::new())?
        .into_iter()
        .map(|(name, _, said)| (name, said.base))
        .collect();
    let jobs: Vec<(String, Planned)> = cases
        .into_iter()
        .enumerate()
        .map(|(index, case)| (format!("case-{:04}", index + 1), case))
        .collect();
    let done = run_all(request, &jobs, &known)?;
    let mut answers = Answers {
        schema_version: SCHEMA_VERSION,
        seed: request.seed,
        rigs: BTreeMap::new(),
        cases: BTreeMap::new(),
    };
    for machine in used {
        let base = base_name(machine);
        let rig = Rig {
            kind: machine.kind().to_owned(),
            baseline: [format!("{base}-1.mcap"), format!("{base}-2.mcap")],
            own: machine.own(),
        };
        answers.rigs.insert(machine.name(), rig);
    }
    let mut rivals = BTreeMap::new();
    for (name, case, said) in done {
        answers.cases.insert(name.clone(), case);
        rivals.insert(name, said);
    }
    write_json(&request.out.join("answers.json"), &answers)?;
    write_json(&request.out.join("baselines.json"), &rivals)?;
    Ok(answers)
}

fn base_name(machine: Machine) -> String {
    format!("base-{}", machine.name())
}

fn base_case(machine: Machine) -> Planned {
    Planned {
        machine,
        class: Class::NullClean,
        what: "baseline".to_owned(),
        plants: Vec::new(),
        twist: Twist::None,
        shows: crate::cases::FULL,
        tolerated: Vec::new(),
        verdicts: Vec::new(),
    }
}

/// Writes a document as indented JSON.
pub(crate) fn write_json(path: &Path, value: &impl serde::Serialize) -> Result<()> {
    let mut text = serde_json::to_string_pretty(value)?;
    text.push('\n');
    fs::write(path, text).with_context(|| format!("write {}", path.display()))
}

type Finished = (String, Case, baseline::Said);

/// What the rivals have in their base, by the name of the rig's baseline.
type Known = BTreeMap<String, Vec<String>>;

fn run_all(
    request: &Request<'_>,
    jobs: &[(String, Planned)],
    known: &Known,
) -> Result<Vec<Finished>> {
    let next = AtomicUsize::new(0);
    let done = Mutex::new(Vec::new());
    thread::scope(|scope| {
        let workers: Vec<_> = (0..request.jobs.max(1))
            .map(|_| {
                scope.spawn(|| -> Result<()> {
                    while let Some((name, planned)) = jobs.get(next.fetch_add(1, Ordering::Relaxed))
                    {
                        let (case, said) = one(request, name, planned, known)?;
                        let mut list = done.lock().expect("no worker panics with the list");
                        list.push((name.clone(), case, said));
                    }
                    Ok(())
                })
            })
            .collect();
        workers.into_iter().try_for_each(|worker| worker.join().expect("a worker panicked"))
    })?;
    let mut done = done.into_inner().expect("no worker panics with the list");
    done.sort_by(|p, q| p.0.cmp(&q.0));
    Ok(done)
}

fn one(
    request: &Request<'_>,
    name: &str,
    planned: &Planned,
    known: &Known,
) -> Result<(Case, baseline::Said)> {
    let known = known.get(&base_name(planned.machine)).map(Vec::as_slice);
    let job = Job { out: request.out, seed: request.seed, name, planned, known };
    match planned.machine {
        Machine::Gantry(index) => job.gantry(index),
        Machine::Ball(index) => job.ball(index),
        Machine::Axis(index) => job.axis(index),
    }
    .with_context(|| format!("generate {name}"))
}

/// One case at work.
struct Job<'a> {
    out: &'a Path,
    seed: u64,
    name: &'a str,
    planned: &'a Planned,
    known: Option<&'a [String]>,
}

const SPLITS: [Split; 2] = [Split::Train, Split::Validation];

impl Job<'_> {
    fn draw(&self, purpose: &str) -> Draw {
        Draw::new(self.seed, &format!("{} {purpose}", self.name))
    }

    fn case(&self, effects: Vec<PlantedEffect>, floors: BTreeMap<String, f64>) -> Case {
        let p = self.planned;
        let text = |list: &[&'static str]| list.iter().map(|s| (*s).to_owned()).collect();
        Case {
            rig: p.machine.name(),
            class: p.class,
            what: p.what.clone(),
            exciting: p.class != Class::CannotShow,
            effects,
            tolerated: text(&p.tolerated),
            verdicts: text(&p.verdicts),
            floors,
        }
    }

    fn gantry(&self, index: usize) -> Result<(Case, baseline::Said)> {
        let mut rig = Gantry::new(self.seed, index);
        let seconds = if self.planned.twist == Twist::TooShort { 1.6 } else { GANTRY_SECONDS };
        twist_gantry(&mut rig, self.planned.twist, self.seed, &mut self.draw("twist"));
        let sizing = plan(Excitation::Full, GANTRY_SECONDS, 1.0, &mut self.draw("sizing"));
        // Where the recorded motion is not to show an effect, it is sized on another alone.
        let recorded: Vec<Plan> = match self.planned.class {
            Class::CannotShow | Class::BadInput => Vec::new(),
            _ => (0..2).map(|session| self.plan(session, seconds).0).collect(),
        };
        let mut effects = Vec::new();
        for plant in &self.planned.plants {
            let before = rig.clone();
            let (magnitude, reached) =
                size_gantry(&rig, plant, (&sizing, &recorded), &mut self.draw("size"));
            let spec = catalogue::spec(plant.name);
            (spec.apply)(&mut rig, plant.on, plant.sign * magnitude);
            effects.push(gantry_truth(plant, &before, &rig, reached));
        }
        if let Twist::Outside(kind) = self.planned.twist {
            outside_gantry(&mut rig, kind, &sizing, &mut self.draw("outside"));
        }
        let mut sessions = Vec::new();
        for session in 0..2 {
            let (plan, mut draw) = self.plan(session, seconds);
            let phases = Phases {
                tooth: [draw.uniform(0.0, TAU), draw.uniform(0.0, TAU)],
                hum: draw.uniform(0.0, TAU),
            };
            let trace = simulate(&rig, Commands::Follow(&plan), phases, &mut draw);
            let far = trace.seen.iter().flatten().map(|v| v.abs()).fold(0.0, f64::max);
            anyhow::ensure!(far < 0.4, "the carriage leaves the board: {far} m");
            let mut seen = observe(&rig, &trace, &mut draw);
            if self.planned.twist == Twist::NoCommands {
                seen.commands.clear();
            }
            self.write(session, |path, label| write_gantry(path, label, &seen, &plan.runs))?;
            sessions.push(seen);
        }
        let floors = gantry_floors(&rig);
        let said = baseline::gantry(&sessions, self.known);
        Ok((self.case(effects, floors), said))
    }

    /// The motion of one session of a gantry, and the draw with which the session goes on.
    fn plan(&self, session: usize, seconds: f64) -> (Plan, Draw) {
        let mut draw = self.draw(&format!("session {session}"));
        (plan(self.planned.shows.gantry, seconds, PACES[session], &mut draw), draw)
    }

    fn ball(&self, index: usize) -> Result<(Case, baseline::Said)> {
        let mut rig = BallRig::new(self.seed, index);
        twist_ball(&mut rig, self.planned.twist, &mut self.draw("twist"));
        let sizing = ball::starts(ball::Rolls::Full, 1.0, &mut self.draw("sizing"));
        let mut effects = Vec::new();
        for plant in &self.planned.plants {
            let spec = ball::spec(plant.name);
            let before = rig.clone();
            let with = |m: f64| {
                let mut with = before.clone();
                (spec.apply)(&mut with, plant.sign * m);
                with
            };
            let known = ball::imitators(spec);
            let visible = |m: f64| ball::visibility(&before, &with(m), &sizing, &known);
            let (magnitude, reached, capped) = bisect(spec.range, plant.multiple, visible);
            rig = with(magnitude);
            let parameter = (spec.parameter, spec.unit, (spec.value)(&rig));
            let mut truth = planted(plant, parameter, &["camera ball"], reached);
            truth.parameters[0].before = spec.known.then(|| (spec.value)(&before));
            truth.capped = capped;
            truth.known = spec.known;
            truth.alike = spec.alike.iter().map(|name| (*name).to_owned()).collect();
            effects.push(truth);
        }
        for session in 0..2 {
            let mut draw = self.draw(&format!("session {session}"));
            let starts = ball::starts(self.planned.shows.ball, PACES[session], &mut draw);
            let rolls = ball::session(&rig, &starts, &mut draw);
            self.write(session, |path, label| write_ball(path, label, &rolls))?;
        }
        let floors = [("m".to_owned(), rig.camera_noise)].into();
        Ok((self.case(effects, floors), baseline::Said::default()))
    }

    fn axis(&self, index: usize) -> Result<(Case, baseline::Said)> {
        let mut rig = AxisRig::new(self.seed, index);
        let mut draw = self.draw("twist");
        match self.planned.twist {
            Twist::Coloured => rig.disturbance_rho = draw.uniform(0.6, 0.97).powf(0.1),
            Twist::Outside(0) => rig.hum = 3.0 * rig.floor(),
            Twist::Outside(_) => rig.twist = 40.0 * rig.floor(),
            _ => {}
        }
        let sizing = axis::reference(axis::Travel::Full, AXIS_SECONDS, 1.0, &mut draw);
        let mut effects = Vec::new();
        for plant in &self.planned.plants {
            let spec = axis::spec(plant.name);
            let before = rig.clone();
            let with = |m: f64| {
                let mut with = before.clone();
                (spec.apply)(&mut with, m);
                with
            };
            let imitators = if spec.known { Vec::new() } else { before.neighbours().to_vec() };
            let visible = |m: f64| axis::visibility(&before, &with(m), &sizing, &imitators);
            let (magnitude, reached, capped) = bisect(spec.range, plant.multiple, visible);
            rig = with(magnitude);
            let parameter = (spec.parameter, spec.unit, (spec.value)(&rig));
            let mut truth = planted(plant, parameter, &["axis force"], reached);
            truth.parameters[0].before = spec.known.then(|| (spec.value)(&before));
            truth.capped = capped;
            truth.known = spec.known;
            truth.alike = spec.alike.iter().map(|name| (*name).to_owned()).collect();
            effects.push(truth);
        }
        let mut sessions = Vec::new();
        for session in 0..2 {
            let mut draw = self.draw(&format!("session {session}"));
            let pace = PACES[session];
            let reference = axis::reference(self.planned.shows.axis, AXIS_SECONDS, pace, &mut draw);
            let phase = draw.uniform(0.0, TAU);
            let trace = axis::simulate(&rig, &reference, phase, &mut draw);
            self.write(session, |path, label| write_axis(path, label, &trace))?;
            sessions.push(trace);
        }
        let floors = [("N".to_owned(), rig.floor()), ("m".to_owned(), rig.encoder)].into();
        Ok((self.case(effects, floors), baseline::axis(&sessions, self.known)))
    }

    fn write(
        &self,
        session: usize,
        write: impl FnOnce(&Path, Label<'_>) -> Result<(), klasktron::recording::RecordingError>,
    ) -> Result<()> {
        let name = format!("{}-{}", self.name, session + 1);
        let label = Label { session: &name, split: SPLITS[session] };
        write(&self.out.join(format!("{name}.mcap")), label)?;
        Ok(())
    }
}

/// Magnitude within `range` that reaches `multiple`: with what it reaches, and whether the range
/// ended first. Without a multiple, the middle of the range.
fn bisect(
    range: [f64; 2],
    multiple: Option<f64>,
    visible: impl Fn(f64) -> f64,
) -> (f64, f64, bool) {
    let [mut low, mut high] = range.map(f64::ln);
    let Some(wanted) = multiple else {
        let middle = (0.5 * (low + high)).exp();
        return (middle, visible(middle), false);
    };
    let most = visible(range[1]);
    if most <= wanted {
        return (range[1], most, true);
    }
    let least = visible(range[0]);
    if wanted <= least {
        return (range[0], least, true);
    }
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if visible(middle.exp()) < wanted { low = middle } else { high = middle }
    }
    let chosen = (0.5 * (low + high)).exp();
    (chosen, visible(chosen), false)
}

/// How well an effect of the gantry shows, and where.
struct Reached {
    multiple: Option<f64>,
    signal: &'static str,
    capped: bool,
}

fn size_gantry(
    rig: &Gantry,
    plant: &Plant,
    (sizing, recorded): (&Plan, &[Plan]),
    draw: &mut Draw,
) -> (f64, Reached) {
    let spec = catalogue::spec(plant.name);
    if spec.sizing == Sizing::Free {
        let magnitude = draw.uniform(spec.range[0], spec.range[1]);
        return (magnitude, Reached { multiple: None, signal: "noise", capped: false });
    }
    let sight = Sight::new(rig, plant, sizing, draw);
    let (mut magnitude, mut multiple, mut capped) =
        bisect(spec.range, plant.multiple, |m| sight.of(m).multiple);
    // A limit that the motion used for sizing reaches may be out of reach in what is recorded.
    let sights: Vec<Sight<'_>> =
        recorded.iter().map(|plan| Sight::new(rig, plant, plan, &mut draw.clone())).collect();
    let least = |m: f64| sights.iter().map(|own| own.of(m).multiple).fold(f64::INFINITY, f64::min);
    if magnitude < spec.range[1] && least(magnitude) < LEAST_SHOWN * multiple {
        (magnitude, multiple, capped) = bisect(spec.range, plant.multiple, least);
    }
    let signal = sight.of(magnitude).signal;
    (magnitude, Reached { multiple: Some(multiple), signal, capped })
}

/// A planned motion of a rig, on which an effect is looked for.
struct Sight<'a> {
    plant: &'a Plant,
    rig: Gantry,
    draw: Draw,
    plain: Observation,
    floors: Floors,
    known: Vec<Observation>,
}

impl<'a> Sight<'a> {
    fn new(rig: &Gantry, plant: &'a Plant, plan: &Plan, draw: &mut Draw) -> Self {
        // Without a camera the effect is sized as if there were one: it would show.
        let rig = Gantry { camera: true, ..rig.clone() };
        let plain = silently(&rig, &mut draw.clone(), Commands::Follow(plan));
        let floors = noise_floors(&rig, &plain, draw);
        let moved =
            |other: Gantry| silently(&other, &mut draw.clone(), Commands::Replay(&plain.commands));
        let known = match catalogue::spec(plant.name).known {
            true => Vec::new(),
            false => rig.neighbours().into_iter().map(moved).collect(),
        };
        Self { plant, rig, draw: draw.clone(), plain, floors, known }
    }

    /// How well the effect shows at a magnitude.
    fn of(&self, magnitude: f64) -> Visibility {
        let spec = catalogue::spec(self.plant.name);
        let mut with = self.rig.clone();
        (spec.apply)(&mut with, self.plant.on, self.plant.sign * magnitude);
        let with = silently(&with, &mut self.draw.clone(), Commands::Replay(&self.plain.commands));
        visibility(&self.floors, &self.plain, &with, &self.known, spec.sizing)
    }
}

/// What `rig` does and shows without anything random.
fn silently(rig: &Gantry, draw: &mut Draw, commands: Commands<'_>) -> Observation {
    let silent = rig.silent();
    let phases = Phases { tooth: [0.3, 1.1], hum: 0.7 };
    observe(&silent, &simulate(&silent, commands, phases, draw), draw)
}

/// Noise of every signal of `rig`: what changes when the same commands are driven again.
fn noise_floors(rig: &Gantry, plain: &Observation, draw: &mut Draw) -> Floors {
    let phases = Phases { tooth: [0.3, 1.1], hum: 0.7 };
    let mut clean = rig.clone();
    clean.sensors.outliers = 0.0;
    clean.sensors.drop = 0.0;
    let again = simulate(&clean, Commands::Replay(&plain.commands), phases, draw);
    floors(plain, &observe(&clean, &again, draw))
}

fn planted(
    plant: &Plant,
    (name, unit, value): (&str, &str, f64),
    signal: &[&str],
    reached: f64,
) -> PlantedEffect {
    PlantedEffect {
        name: plant.name.to_owned(),
        domain: plant.name.split('.').next().unwrap_or_default().to_owned(),
        axis: Vec::new(),
        parameters: vec![Parameter {
            name: name.to_owned(),
            unit: unit.to_owned(),
            value,
            before: None,
        }],
        wanted_multiple: plant.multiple,
        noise_multiple: Some(reached),
        signal: signal.concat(),
        capped: false,
        known: false,
        alike: Vec::new(),
    }
}

fn gantry_truth(plant: &Plant, before: &Gantry, after: &Gantry, reached: Reached) -> PlantedEffect {
    let spec = catalogue::spec(plant.name);
    let names = match spec.place {
        Place::Motors => ["a", "b"],
        Place::Rails => ["x", "y"],
        Place::Whole => ["", ""],
    };
    let on: Vec<usize> = (0..2).filter(|i| plant.on[*i] > 0.0).collect();
    let read = on[0];
    let value = (spec.value)(after, read);
    let mut truth = planted(plant, (spec.parameter, spec.unit, value), &[reached.signal], 0.0);
    let old = (spec.value)(before, read);
    truth.parameters[0].before =
        Some(old).filter(|old| spec.known || (old.is_finite() && *old != 0.0));
    for (name, unit, value) in catalogue::fixed(plant.name) {
        truth.parameters.push(Parameter {
            name: (*name).to_owned(),
            unit: (*unit).to_owned(),
            value: *value,
            before: None,
        });
    }
    if spec.place != Place::Whole {
        truth.axis = on.iter().map(|i| names[*i].to_owned()).collect();
    }
    truth.noise_multiple = reached.multiple;
    truth.capped = reached.capped;
    truth.known = spec.known;
    truth.domain = spec.domain().to_owned();
    truth.alike = spec.alike.iter().map(|name| (*name).to_owned()).collect();
    truth
}

fn gantry_floors(rig: &Gantry) -> BTreeMap<String, f64> {
    let s = &rig.sensors;
    [
        ("m", s.camera_noise),
        ("m/s", s.velocity_noise),
        ("turn/s", s.velocity_noise / BELT_PER_TURN),
        ("N m", s.torque_noise),
        ("N", s.torque_noise * BELT_PER_TORQUE),
    ]
    .into_iter()
    .map(|(unit, value)| (unit.to_owned(), value))
    .collect()
}

fn twist_gantry(rig: &mut Gantry, twist: Twist, seed: u64, draw: &mut Draw) {
    let s = &mut rig.sensors;
    match twist {
        Twist::Coloured => {
            s.disturbance = draw.uniform(0.15, 0.4);
            s.disturbance_rho = draw.uniform(0.6, 0.97);
            s.camera_rho = draw.uniform(0.6, 0.97);
        }
        Twist::Outliers => s.outliers = 0.005,
        Twist::Frames => s.drop = draw.uniform(0.02, 0.08),
        Twist::NoCamera => rig.camera = false,
        Twist::Disarmed => rig.disarmed = true,
        Twist::ByHand => {
            rig.disarmed = true;
            s.disturbance = 6.0;
            s.disturbance_rho = 0.97;
        }
        Twist::DriftingClock => s.skew = draw.uniform(0.01, 0.03),
        Twist::OtherMachine => {
            let other = Gantry::new(seed.wrapping_add(1), 40 + draw.below(9));
            rig.drive.kp = other.drive.kp.map(|kp| 0.6 * kp);
            rig.drive.ki = other.drive.ki.map(|ki| 0.4 * ki);
            rig.drive.ramp = rig.drive.ramp.map(|ramp| 0.55 * ramp);
            for rail in &mut rig.friction[..2] {
                rail.coulomb = 2.0 * rail.coulomb + 2.0;
                rail.viscous = 2.0 * rail.viscous + 3.0;
            }
        }
        Twist::None | Twist::TooShort | Twist::NoCommands | Twist::Outside(_) => {}
    }
}

/// An effect in no catalogue, three times the noise.
fn outside_gantry(rig: &mut Gantry, kind: usize, sizing: &Plan, draw: &mut Draw) {
    let set = |rig: &mut Gantry, m: f64| {
        let odd = &mut rig.outside;
        match kind {
            0 => odd.hum = m,
            1 => odd.chirp = m,
            2 => odd.product_friction = m,
            3 => odd.dead_spot = 0.05 * m,
            4 => odd.square_coupling = 3.0 * m,
            _ => odd.spiral = 10.0 * m,
        }
    };
    let phases = Phases { tooth: [0.3, 1.1], hum: 0.7 };
    let look = |rig: &Gantry, commands: Commands<'_>| {
        let silent = rig.silent();
        let mut draw = draw.clone();
        observe(&silent, &simulate(&silent, commands, phases, &mut draw), &mut draw)
    };
    let plain = look(rig, Commands::Follow(sizing));
    let floors = noise_floors(rig, &plain, &mut draw.clone());
    let known: Vec<Observation> = rig
        .neighbours()
        .iter()
        .map(|other| look(other, Commands::Replay(&plain.commands)))
        .collect();
    let (m, _, _) = bisect([0.05, 8.0], Some(3.0), |m| {
        let mut with = rig.clone();
        set(&mut with, m);
        let with = look(&with, Commands::Replay(&plain.commands));
        visibility(&floors, &plain, &with, &known, Sizing::Moving).multiple
    });
    set(rig, m);
}

fn twist_ball(rig: &mut BallRig, twist: Twist, draw: &mut Draw) {
    match twist {
        Twist::Coloured => rig.camera_rho = draw.uniform(0.6, 0.97),
        Twist::Outliers => rig.outliers = 0.005,
        Twist::Frames => rig.drop = draw.uniform(0.02, 0.08),
        Twist::Outside(0) => rig.gust = draw.uniform(0.03, 0.08),
        Twist::Outside(_) => rig.swirl = draw.sign() * draw.uniform(0.3, 0.8),
        _ => {}
    }
}
