//! The text of a MuJoCo model.

use super::{
    MJCF_TIMESTEP_S,
    mechanics::{CARRIAGE_KG, Coupling, Drive, Mechanics},
};
use crate::{board::BoardSize, twin::Twin};
use std::fmt::Write as _;

/// Mass of a setpoint (kg): the loop's force of some 100 N changes its velocity by 1e-4 m/s in a second.
const SETPOINT_KG: f64 = 1e6;
/// Time constant with which a setpoint takes its commanded velocity, in integration steps.
const SETPOINT_STEPS: f64 = 0.05;
/// Samples of the history of a delayed control beyond its delay.
const SPARE_SAMPLES: f64 = 2.0;
/// Largest fraction of the mass along an axis that is no armature.
const LARGEST_FRACTION: f64 = 0.5;

/// Attribute `name="value"`; nothing for zero.
fn attribute(name: &str, value: f64) -> String {
    if value == 0.0 { String::new() } else { format!(" {name}=\"{value}\"") }
}

/// Attributes of a delayed control: held until the next (`zoh`), or linear between samples (`linear`).
fn delayed(delay: f64, between: &str) -> String {
    if delay == 0.0 {
        return String::new();
    }
    let samples = (delay / MJCF_TIMESTEP_S).ceil() + SPARE_SAMPLES;
    format!(" delay=\"{delay}\" nsample=\"{samples}\" interp=\"{between}\"")
}

fn head(twin: &Twin, notes: &[&str]) -> String {
    let friction = 2.0 * MJCF_TIMESTEP_S;
    let mut text = "<mujoco model=\"klasktron\">\n  <!--\n".to_owned();
    for note in notes {
        writeln!(text, "    {note}").ok();
    }
    let effects: Vec<&str> = twin.instances.iter().map(|own| own.effect.name).collect();
    // Two hyphens would end the comment; no name has them.
    writeln!(text, "    Effects of the twin: {}.\n  -->", effects.join(", ")).ok();
    writeln!(text, "  <option timestep=\"{MJCF_TIMESTEP_S}\" integrator=\"implicitfast\"/>").ok();
    text += "  <default>\n    <geom contype=\"0\" conaffinity=\"0\" mass=\"0\"/>\n";
    writeln!(
        text,
        "    <joint type=\"slide\" solreffriction=\"{friction} 1\" solimpfriction=\"0.9999 0.9999 0.001\"/>"
    )
    .ok();
    writeln!(
        text,
        "    <tendon solreffriction=\"{friction} 1\" solimpfriction=\"0.9999 0.9999 0.001\"/>"
    )
    .ok();
    text + "  </default>\n"
}

/// The model of one gantry.
pub(super) fn table(twin: &Twin, mechanics: &Mechanics) -> String {
    let mut text = head(
        twin,
        &[
            "Drives, gantry and striker of one player, in the board frame: x across, y goal to goal.",
            "Controls: velocity of the belts (m/s), a = vx + vy and b = vx - vy; forces in N, masses in kg.",
            "The setpoints are the velocities that the drives follow: their mass is so large that nothing else moves",
            "them, and the limit of their force is the slew limit. The tendons loop_a and loop_b are the velocity",
            "loops: damping acts on the velocity error, stiffness on its integral.",
        ],
    );
    text += "  <worldbody>\n";
    let BoardSize { short_side, long_side } = BoardSize::default();
    let board = [0.5 * short_side, 0.5 * long_side];
    writeln!(
        text,
        "    <geom name=\"board\" type=\"box\" size=\"{} {} 0.002\" pos=\"0 0 -0.002\" rgba=\"0.8 0.7 0.5 0.3\"/>",
        board[0], board[1]
    )
    .ok();
    for name in ["a", "b"] {
        writeln!(
            text,
            "    <body name=\"setpoint_{name}\">\n      <joint name=\"setpoint_{name}\" axis=\"1 0 0\"/>\n      \
             <inertial pos=\"0 0 0\" mass=\"{SETPOINT_KG}\" diaginertia=\"1 1 1\"/>\n    </body>"
        )
        .ok();
    }
    bodies(twin, mechanics, &mut text);
    text += "  </worldbody>\n";
    tendons(mechanics, &mut text);
    text += "  <actuator>\n";
    for (name, drive) in ["a", "b"].into_iter().zip(&mechanics.drives) {
        text += &setpoint(name, drive);
    }
    for (name, drive) in ["a", "b"].into_iter().zip(&mechanics.drives) {
        if let Some(limit) = drive.force_limit {
            writeln!(
                text,
                "    <general name=\"force_{name}\" tendon=\"loop_{name}\" gainprm=\"0\" biastype=\"affine\" \
                 biasprm=\"0 {} {}\" forcerange=\"-{limit} {limit}\"/>",
                -drive.integral, -drive.proportional
            )
            .ok();
        }
    }
    constant_forces(mechanics, &["x", "y"], &mut text);
    text += "  </actuator>\n  <sensor>\n";
    for joint in ["x", "y"] {
        writeln!(text, "    <jointpos name=\"{joint}\" joint=\"{joint}\"/>").ok();
        writeln!(text, "    <jointvel name=\"v{joint}\" joint=\"{joint}\"/>").ok();
    }
    text + "    <framepos name=\"striker\" objtype=\"body\" objname=\"striker\"/>\n  </sensor>\n</mujoco>\n"
}

/// Bridge, carriage and striker.
fn bodies(twin: &Twin, mechanics: &Mechanics, text: &mut String) {
    let striker = twin.striker_mass;
    let [x, y] = mechanics.mass;
    // The striker is behind a spring, or fixed to the carriage; what moves has the twin's mass in all.
    let carriage = CARRIAGE_KG.min(LARGEST_FRACTION * (x.min(y) - striker)).max(0.0);
    let bridge = 0.5 * carriage;
    let slide = |name: &str, axis: &str, index: usize, mass: f64| {
        let guide = &mechanics.guides[index];
        format!(
            "<joint name=\"{name}\" axis=\"{axis}\" armature=\"{}\"{}{}{}/>",
            mechanics.mass[index] - mass,
            attribute("damping", guide.damping),
            attribute("frictionloss", guide.friction),
            attribute("stiffness", guide.stiffness),
        )
    };
    let inertia = "diaginertia=\"0.001 0.001 0.001\"";
    let y = slide("y", "0 1 0", 1, bridge + carriage + striker);
    let x = slide("x", "1 0 0", 0, carriage + striker);
    let spring = mechanics.coupling.map_or_else(String::new, |own| springs(&own));
    writeln!(
        text,
        "    <body name=\"bridge\">
      {y}
      <inertial pos=\"0 0 0\" mass=\"{bridge}\" {inertia}/>
      <geom type=\"box\" size=\"0.16 0.01 0.005\" pos=\"0 0 -0.02\" rgba=\"0.4 0.4 0.4 1\"/>
      <body name=\"carriage\">
        {x}
        <inertial pos=\"0 0 0\" mass=\"{carriage}\" {inertia}/>
        <geom type=\"box\" size=\"0.015 0.015 0.006\" pos=\"0 0 -0.012\" rgba=\"0.2 0.2 0.2 1\"/>
        <body name=\"striker\">
{spring}          <inertial pos=\"0 0 0\" mass=\"{striker}\" diaginertia=\"1e-6 1e-6 1e-6\"/>
          <geom type=\"cylinder\" size=\"0.0075 0.015\" pos=\"0 0 0.015\" rgba=\"0.1 0.3 0.8 1\"/>
        </body>
      </body>
    </body>"
    )
    .ok();
}

/// Joints of the striker on its magnet.
fn springs(coupling: &Coupling) -> String {
    let Coupling { stiffness, damping } = coupling;
    ["x", "y"]
        .map(|axis| {
            let direction = if axis == "x" { "1 0 0" } else { "0 1 0" };
            format!(
                "          <joint name=\"striker_{axis}\" axis=\"{direction}\" stiffness=\"{stiffness}\" \
                 damping=\"{damping}\"/>\n"
            )
        })
        .concat()
}

/// Velocity loops, and friction of the belts.
fn tendons(mechanics: &Mechanics, text: &mut String) {
    *text += "  <tendon>\n";
    for ((name, drive), sign) in ["a", "b"].into_iter().zip(&mechanics.drives).zip([1.0, -1.0]) {
        // With a limit, an actuator on this tendon is the loop.
        let gains = match drive.force_limit {
            Some(_) => String::new(),
            None => format!(
                " stiffness=\"{}\" damping=\"{}\" springlength=\"0\"",
                drive.integral, drive.proportional
            ),
        };
        writeln!(
            text,
            "    <fixed name=\"loop_{name}\"{gains}>\n      <joint joint=\"setpoint_{name}\" coef=\"1\"/>\n      \
             <joint joint=\"x\" coef=\"-1\"/>\n      <joint joint=\"y\" coef=\"{}\"/>\n    </fixed>",
            -sign
        )
        .ok();
        if drive.damping != 0.0 || drive.friction != 0.0 {
            writeln!(
                text,
                "    <fixed name=\"belt_{name}\"{}{}>\n      <joint joint=\"x\" coef=\"1\"/>\n      \
                 <joint joint=\"y\" coef=\"{sign}\"/>\n    </fixed>",
                attribute("damping", drive.damping),
                attribute("frictionloss", drive.friction),
            )
            .ok();
        }
    }
    *text += "  </tendon>\n";
}

/// Actuator that drives a setpoint to its commanded velocity.
fn setpoint(name: &str, drive: &Drive) -> String {
    let kv = SETPOINT_KG / (SETPOINT_STEPS * MJCF_TIMESTEP_S);
    let lag = match drive.lag {
        0.0 => String::new(),
        lag => format!(" dyntype=\"filterexact\" dynprm=\"{lag}\""),
    };
    let limit = drive.slew.map_or_else(String::new, |slew| {
        let force = SETPOINT_KG * slew;
        format!(" forcerange=\"-{force} {force}\"")
    });
    format!(
        "    <general name=\"{name}\" joint=\"setpoint_{name}\" gainprm=\"{}\" biastype=\"affine\" biasprm=\"{} 0 -{kv}\"{lag}{limit}{}/>\n",
        kv * drive.gain,
        kv * drive.offset,
        delayed(drive.delay, "zoh")
    )
}

/// Constant forces along joints, as actuators whose control has no effect.
fn constant_forces(mechanics: &Mechanics, joints: &[&str], text: &mut String) {
    for (joint, guide) in joints.iter().zip(&mechanics.guides) {
        if guide.force != 0.0 {
            writeln!(
                text,
                "    <general name=\"force_{joint}\" joint=\"{joint}\" gainprm=\"0\" biastype=\"affine\" \
                 biasprm=\"{} 0 0\"/>",
                guide.force
            )
            .ok();
        }
    }
}

/// The model of a single axis.
pub(super) fn axis(twin: &Twin, mechanics: &Mechanics) -> String {
    let frame = twin.axis_frame;
    let (input, position) =
        frame.map_or(("N", "m"), |own| (own.scales.input_unit, own.scales.position_unit));
    let kind = if position == "rad" { "hinge" } else { "slide" };
    let controls = format!(
        "Control: the input ({input}); position in {position}. Inertia and friction are in units of the input."
    );
    let mut text = head(twin, &["A single axis.", &controls]);
    let (guide, drive) = (&mechanics.guides[0], &mechanics.drives[0]);
    let origin = twin.position_origin();
    let spring = match guide.stiffness {
        0.0 => String::new(),
        stiffness => format!(" stiffness=\"{stiffness}\" springref=\"{origin}\""),
    };
    // Motor and guide of a single axis are one coordinate.
    writeln!(
        text,
        "  <worldbody>\n    <body name=\"axis\">\n      <joint name=\"axis\" type=\"{kind}\" axis=\"1 0 0\" armature=\"{}\"{}{}{spring}/>\n      \
         <inertial pos=\"0 0 0\" mass=\"{mass}\" diaginertia=\"{mass} {mass} {mass}\"/>\n      \
         <geom type=\"box\" size=\"0.02 0.02 0.02\"/>\n    </body>\n  </worldbody>",
        mechanics.mass[0] * (1.0 - SMALL),
        attribute("damping", guide.damping + drive.damping),
        attribute("frictionloss", guide.friction + drive.friction),
        mass = mechanics.mass[0] * SMALL,
    )
    .ok();
    let lag = match drive.lag {
        0.0 => String::new(),
        lag => format!(" dyntype=\"filterexact\" dynprm=\"{lag}\""),
    };
    let limit = drive
        .force_limit
        .map_or_else(String::new, |limit| format!(" forcerange=\"-{limit} {limit}\""));
    writeln!(
        text,
        "  <actuator>\n    <general name=\"input\" joint=\"axis\" gainprm=\"{}\" biastype=\"affine\" biasprm=\"{} 0 0\"{lag}{limit}{}/>",
        drive.gain,
        drive.offset,
        delayed(drive.delay, "linear")
    )
    .ok();
    constant_forces(mechanics, &["axis"], &mut text);
    text + "  </actuator>\n  <sensor>\n    <jointpos name=\"position\" joint=\"axis\"/>\n    \
     <jointvel name=\"velocity\" joint=\"axis\"/>\n  </sensor>\n</mujoco>\n"
}

/// Fraction of the inertia of a single axis that is the body's own; MuJoCo demands some.
const SMALL: f64 = 1e-3;
