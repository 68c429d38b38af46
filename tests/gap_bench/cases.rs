//! Which cases there are: the plan of the bench, before anything is simulated.

use crate::{
    axis::{self, Travel},
    ball::{self, Rolls},
    catalogue::{self, Place, Sizing},
    draw::Draw,
    plan::Excitation,
    truth::Class,
};

/// Rigs of each kind.
pub(crate) const GANTRY_RIGS: usize = 5;
pub(crate) const BALL_RIGS: usize = 2;
pub(crate) const AXIS_RIGS: usize = 2;

/// The machine of a case.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Machine {
    Gantry(usize),
    Ball(usize),
    Axis(usize),
}

impl Machine {
    pub(crate) fn name(self) -> String {
        match self {
            Self::Gantry(index) => format!("gantry-{index}"),
            Self::Ball(index) => format!("ball-{index}"),
            Self::Axis(index) => format!("axis-{index}"),
        }
    }

    pub(crate) fn kind(self) -> &'static str {
        match self {
            Self::Gantry(_) => "gantry",
            Self::Ball(_) => "ball",
            Self::Axis(_) => "axis",
        }
    }

    /// What the rig has that the plain twin lacks.
    pub(crate) fn own(self) -> Vec<String> {
        match self {
            Self::Gantry(1) => vec!["sensor.camera_latency".to_owned()],
            Self::Gantry(2) => vec!["drive.delay".to_owned()],
            _ => Vec::new(),
        }
    }
}

/// One effect to be planted.
#[derive(Debug, Clone)]
pub(crate) struct Plant {
    pub(crate) name: &'static str,
    /// Which of the two motors or rails have it.
    pub(crate) on: [f64; 2],
    pub(crate) sign: f64,
    /// Multiple of the noise; `None` takes the size from the range.
    pub(crate) multiple: Option<f64>,
}

/// What else is unusual about the recordings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Twist {
    None,
    Coloured,
    Outliers,
    Frames,
    Outside(usize),
    NoCamera,
    TooShort,
    NoCommands,
    Disarmed,
    ByHand,
    DriftingClock,
    OtherMachine,
}

/// How many kinds of effects outside every catalogue each machine knows.
pub(crate) const OUTSIDE_GANTRY: usize = 6;
pub(crate) const OUTSIDE_BALL: usize = 2;
pub(crate) const OUTSIDE_AXIS: usize = 2;

/// What the sessions can show.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Shows {
    pub(crate) gantry: Excitation,
    pub(crate) ball: Rolls,
    pub(crate) axis: Travel,
}

/// Everything there is to see.
pub(crate) const FULL: Shows =
    Shows { gantry: Excitation::Full, ball: Rolls::Full, axis: Travel::Full };

/// One case to be generated.
#[derive(Debug, Clone)]
pub(crate) struct Planned {
    pub(crate) machine: Machine,
    pub(crate) class: Class,
    pub(crate) what: String,
    pub(crate) plants: Vec<Plant>,
    pub(crate) twist: Twist,
    pub(crate) shows: Shows,
    pub(crate) tolerated: Vec<&'static str>,
    pub(crate) verdicts: Vec<&'static str>,
}

fn plain(machine: Machine, class: Class, what: &str) -> Planned {
    Planned {
        machine,
        class,
        what: what.to_owned(),
        plants: Vec::new(),
        twist: Twist::None,
        shows: FULL,
        tolerated: Vec::new(),
        verdicts: Vec::new(),
    }
}

/// A machine for the gantry effect `name`.
fn gantry_for(name: &str, draw: &mut Draw) -> Machine {
    Machine::Gantry(catalogue::spec(name).rig.unwrap_or_else(|| draw.below(GANTRY_RIGS)))
}

fn plant(name: &'static str, multiple: Option<f64>, draw: &mut Draw) -> Plant {
    let sign = draw.sign();
    Plant { name, on: [1.0, 1.0], sign, multiple }
}

fn gantry_plant(name: &'static str, multiple: Option<f64>, draw: &mut Draw) -> Plant {
    let spec = catalogue::spec(name);
    let single = spec.place != Place::Whole && draw.chance(0.3);
    let on = if single { draw.pick(&[[1.0, 0.0], [0.0, 1.0]]) } else { [1.0, 1.0] };
    let sign = if spec.signed { draw.sign() } else { 1.0 };
    let multiple = multiple.filter(|_| spec.sizing != Sizing::Free);
    Plant { name, on, sign, multiple }
}

fn ball_plant(name: &'static str, multiple: Option<f64>, draw: &mut Draw) -> Plant {
    let sign = if ball::spec(name).signed { draw.sign() } else { 1.0 };
    Plant { name, on: [1.0, 1.0], sign, multiple }
}

/// Multiples of the noise at which single effects are asked.
pub(crate) const MULTIPLES: [f64; 3] = [3.0, 1.0, 0.5];

fn singles(draw: &mut Draw) -> Vec<Planned> {
    let mut out = Vec::new();
    for multiple in MULTIPLES {
        for spec in catalogue::all() {
            let mut case = plain(gantry_for(spec.name, draw), Class::Single, "one effect");
            case.plants.push(gantry_plant(spec.name, Some(multiple), draw));
            out.push(case);
        }
        for spec in ball::EFFECTS {
            let machine = Machine::Ball(draw.below(BALL_RIGS));
            let mut case = plain(machine, Class::Single, "one effect");
            case.plants.push(ball_plant(spec.name, Some(multiple), draw));
            out.push(case);
        }
        for spec in axis::EFFECTS {
            let machine = Machine::Axis(draw.below(AXIS_RIGS));
            let mut case = plain(machine, Class::Single, "one effect");
            case.plants.push(plant(spec.name, Some(multiple), draw));
            case.plants[0].sign = 1.0;
            out.push(case);
        }
    }
    out
}

/// A rig for the `index`-th null: mostly gantries.
fn rotating(index: usize) -> Machine {
    match index % 8 {
        5 | 7 => Machine::Ball(index / 8 % BALL_RIGS),
        6 => Machine::Axis(index / 8 % AXIS_RIGS),
        low => Machine::Gantry((low + index / 8) % GANTRY_RIGS),
    }
}

fn nulls(each: usize, draw: &mut Draw) -> Vec<Planned> {
    let mut out = Vec::new();
    for index in 0..each {
        let machine = rotating(index);
        let mut clean = plain(machine, Class::NullClean, "nothing changed");
        clean.verdicts = vec!["none"];
        out.push(clean);
        out.push(refit(machine, draw));
        for (class, twist, what, tolerated) in [
            (Class::NullColoured, Twist::Coloured, "coloured noise", vec!["sensor.noise_model"]),
            (Class::NullOutliers, Twist::Outliers, "camera outliers", vec!["sensor.noise_model"]),
            (
                Class::NullFrames,
                Twist::Frames,
                "frames dropped and doubled",
                vec!["sensor.frame_drop", "sensor.frame_jitter", "sensor.noise_model"],
            ),
        ] {
            // Outliers and frames are the camera's; the axis has none.
            let camera = class != Class::NullColoured;
            let machine = match machine {
                Machine::Axis(index) if camera => Machine::Ball(index),
                machine => machine,
            };
            let mut case = plain(machine, class, what);
            case.twist = twist;
            case.tolerated = tolerated;
            out.push(case);
        }
    }
    out
}

/// Only known parameters are wrong.
fn refit(machine: Machine, draw: &mut Draw) -> Planned {
    let mut case = plain(machine, Class::NullRefit, "known parameters changed");
    let multiple = Some(draw.pick(&[1.0, 2.0, 4.0]));
    let chosen = match machine {
        Machine::Gantry(index) => {
            let mut names = vec![
                "drive.friction.coulomb",
                "drive.friction.viscous",
                "drive.saturation.slew",
                "drive.velocity_loop",
            ];
            match index {
                1 => names.push("sensor.camera_latency"),
                2 => names.push("drive.delay"),
                _ => {}
            }
            let mut plant = gantry_plant(draw.pick(&names), multiple, draw);
            plant.on = [1.0; 2];
            plant
        }
        Machine::Ball(_) => {
            let name = draw.pick(&["ball.rolling_resistance", "impact.wall_restitution"]);
            ball_plant(name, multiple, draw)
        }
        Machine::Axis(_) => {
            let name = draw.pick(&["drive.friction.coulomb", "drive.friction.viscous"]);
            Plant { name, on: [1.0; 2], sign: 1.0, multiple }
        }
    };
    case.tolerated.push(chosen.name);
    case.plants.push(chosen);
    case.verdicts = vec!["refit_only", "none"];
    case
}

/// Pairs of effects in different domains, on any rig.
const PAIRS: [[&str; 2]; 16] = [
    ["drive.delay", "sensor.camera_scale_rotation"],
    ["drive.friction.stribeck", "sensor.camera_latency"],
    ["drive.friction.asymmetric", "gantry.cross_coupling"],
    ["drive.gain", "coupling.magnet_spring"],
    ["drive.backlash", "sensor.camera_distortion"],
    ["drive.friction.quadratic", "sensor.clock_skew"],
    ["drive.lag1", "gantry.squareness"],
    ["drive.input_deadband", "sensor.camera_latency"],
    ["gantry.racking", "sensor.frame_jitter"],
    ["gantry.mass_position", "coupling.striker_wobble"],
    ["drive.friction.position", "sensor.camera_scale_rotation"],
    ["drive.ripple.pulley", "sensor.camera_latency"],
    ["drive.offset", "gantry.endstop"],
    ["drive.supply_sag", "sensor.encoder_eccentricity"],
    ["drive.friction.load", "gantry.squareness"],
    ["drive.saturation.torque_speed", "sensor.camera_distortion"],
];

const TRIPLES: [[&str; 3]; 4] = [
    ["drive.delay", "gantry.cross_coupling", "sensor.camera_latency"],
    ["drive.friction.stribeck", "gantry.endstop", "sensor.camera_scale_rotation"],
    ["drive.gain", "drive.friction.quadratic", "coupling.magnet_spring"],
    ["drive.input_deadband", "gantry.mass_position", "sensor.clock_skew"],
];

const BALL_PAIRS: [[&str; 2]; 4] = [
    ["ball.tilt", "impact.wall_restitution_speed"],
    ["ball.air_drag", "impact.wall_location"],
    ["ball.board_curvature", "impact.wall_friction_spin"],
    ["ball.stiction_patch", "sensor.camera_distortion"],
];

fn several(draw: &mut Draw) -> Vec<Planned> {
    let mut out = Vec::new();
    for pair in PAIRS {
        let machine = Machine::Gantry(draw.below(GANTRY_RIGS));
        let mut case = plain(machine, Class::Two, "two effects");
        for name in pair {
            let multiple = draw.pick(&[1.5, 3.0]);
            case.plants.push(gantry_plant(name, Some(multiple), draw));
        }
        out.push(case);
    }
    for pair in BALL_PAIRS {
        let machine = Machine::Ball(draw.below(BALL_RIGS));
        let mut case = plain(machine, Class::Two, "two effects");
        for name in pair {
            let multiple = draw.pick(&[2.0, 4.0]);
            case.plants.push(ball_plant(name, Some(multiple), draw));
        }
        out.push(case);
    }
    for triple in TRIPLES {
        let machine = Machine::Gantry(draw.below(GANTRY_RIGS));
        let mut case = plain(machine, Class::Three, "three effects");
        for name in triple {
            case.plants.push(gantry_plant(name, Some(3.0), draw));
        }
        out.push(case);
    }
    out
}

fn outside() -> Vec<Planned> {
    let mut out = Vec::new();
    for round in 0..3 {
        let mut add = |machine: Machine, kind: usize| {
            let mut case = plain(machine, Class::Outside, "outside the catalogue");
            case.twist = Twist::Outside(kind);
            case.verdicts = vec!["unexplained"];
            out.push(case);
        };
        for kind in 0..OUTSIDE_GANTRY {
            add(Machine::Gantry((kind + round) % GANTRY_RIGS), kind);
        }
        for kind in 0..OUTSIDE_BALL {
            add(Machine::Ball((kind + round) % BALL_RIGS), kind);
        }
        for kind in 0..OUTSIDE_AXIS {
            add(Machine::Axis((kind + round) % AXIS_RIGS), kind);
        }
    }
    out
}

/// Effects that are there and that the excitation cannot show.
fn hidden(draw: &mut Draw) -> Vec<Planned> {
    let show = |gantry| Shows { gantry, ..FULL };
    let mut out = Vec::new();
    let list: [(&'static str, Shows, Twist); 14] = [
        ("drive.friction.stribeck", show(Excitation::Fast), Twist::None),
        ("drive.friction.presliding", show(Excitation::Fast), Twist::None),
        ("drive.saturation.torque_speed", show(Excitation::Slow), Twist::None),
        ("drive.supply_sag", show(Excitation::Slow), Twist::None),
        ("drive.friction.quadratic", show(Excitation::Slow), Twist::None),
        ("gantry.mass_position", show(Excitation::Slow), Twist::None),
        ("gantry.cross_coupling", show(Excitation::OnlyX), Twist::None),
        ("gantry.racking", show(Excitation::OnlyX), Twist::None),
        ("gantry.endstop", show(Excitation::Slow), Twist::None),
        ("drive.friction.asymmetric", show(Excitation::OneWay), Twist::None),
        ("coupling.magnet_spring", FULL, Twist::NoCamera),
        ("coupling.striker_wobble", FULL, Twist::NoCamera),
        ("sensor.camera_latency", FULL, Twist::NoCamera),
        ("sensor.camera_scale_rotation", FULL, Twist::NoCamera),
    ];
    for (name, shows, twist) in list {
        let machine = Machine::Gantry([0, 3][draw.below(2)]);
        let mut case = plain(machine, Class::CannotShow, "excitation too poor");
        let mut plant = gantry_plant(name, Some(3.0), draw);
        plant.on = [1.0; 2];
        case.plants.push(plant);
        (case.shows, case.twist) = (shows, twist);
        out.push(case);
    }
    for (name, rolls) in [
        ("impact.wall_restitution_speed", Rolls::OneSpeed),
        ("impact.wall_restitution_speed", Rolls::NoWalls),
        ("impact.wall_friction_spin", Rolls::NoWalls),
        ("impact.wall_location", Rolls::NoWalls),
        ("ball.air_drag", Rolls::NoWalls),
    ] {
        let machine = Machine::Ball(draw.below(BALL_RIGS));
        let mut case = plain(machine, Class::CannotShow, "excitation too poor");
        case.plants.push(ball_plant(name, Some(3.0), draw));
        case.shows.ball = rolls;
        out.push(case);
    }
    for (name, travel) in
        [("drive.friction.stribeck", Travel::Fast), ("drive.friction.asymmetric", Travel::OneWay)]
    {
        let machine = Machine::Axis(draw.below(AXIS_RIGS));
        let mut case = plain(machine, Class::CannotShow, "excitation too poor");
        let plant = Plant { name, on: [1.0; 2], sign: 1.0, multiple: Some(3.0) };
        case.plants.push(plant);
        case.shows.axis = travel;
        out.push(case);
    }
    for case in &mut out {
        case.verdicts = vec!["not_testable"];
    }
    out
}

fn bad(rounds: usize) -> Vec<Planned> {
    let mut out = Vec::new();
    for round in 0..rounds {
        let list: [(&str, Twist, Excitation, &[&'static str]); 7] = [
            ("too short", Twist::TooShort, Excitation::Full, &["not_testable"]),
            (
                "no commands",
                Twist::NoCommands,
                Excitation::Full,
                &["input_not_connected", "not_testable"],
            ),
            (
                "motors off while commands are logged",
                Twist::Disarmed,
                Excitation::Full,
                &["input_not_connected"],
            ),
            (
                "motors off and moved by hand",
                Twist::ByHand,
                Excitation::Full,
                &["input_not_connected"],
            ),
            ("one direction only", Twist::None, Excitation::OneWay, &["not_testable", "none"]),
            (
                "camera clock runs away",
                Twist::DriftingClock,
                Excitation::Full,
                &["not_testable", "different_machine", "named", "input_not_connected"],
            ),
            ("another machine", Twist::OtherMachine, Excitation::Full, &["different_machine"]),
        ];
        for (index, (what, twist, gantry, verdicts)) in list.into_iter().enumerate() {
            let machine = Machine::Gantry((index + round) % GANTRY_RIGS);
            let mut case = plain(machine, Class::BadInput, what);
            case.twist = twist;
            case.shows.gantry = gantry;
            case.verdicts = verdicts.to_vec();
            if twist == Twist::DriftingClock {
                case.tolerated = vec!["sensor.clock_skew"];
            }
            out.push(case);
        }
    }
    out
}

/// How many cases of the whole set are wanted.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Extent {
    /// Some forty, of all classes.
    Quick,
    All,
    /// About so many, in the proportions of the whole set.
    About(usize),
}

/// The plan of the bench, in an order that tells nothing.
pub(crate) fn plan(seed: u64, extent: Extent) -> Vec<Planned> {
    let mut draw = Draw::new(seed, "plan");
    let mut groups = vec![
        nulls(24, &mut draw),
        singles(&mut draw),
        several(&mut draw),
        outside(),
        hidden(&mut draw),
        bad(2),
    ];
    let whole: usize = groups.iter().map(Vec::len).sum();
    let wanted = match extent {
        Extent::All => whole,
        Extent::Quick => 42,
        Extent::About(count) => count.clamp(1, whole),
    };
    let mut out = Vec::new();
    for group in &mut groups {
        let share = (group.len() * wanted).div_ceil(whole);
        if share < group.len() {
            thin(group, share, &mut draw);
        }
        out.append(group);
    }
    draw.shuffle(&mut out);
    out
}

/// Keeps `count` of `group`: nulls evenly by class, the rest at random, large effects first.
fn thin(group: &mut Vec<Planned>, count: usize, draw: &mut Draw) {
    let mut order: Vec<usize> = (0..group.len()).collect();
    if !group[0].class.is_null() {
        draw.shuffle(&mut order);
    }
    order.truncate(count);
    order.sort_unstable();
    let kept: Vec<Planned> = order.into_iter().map(|index| group[index].clone()).collect();
    *group = kept;
}
