//! Checks of the data before any fit: enough motion, in both directions, connected to the input.

mod axis;

use super::{findings::Verdict, problem, rounds::Task, thresholds::Thresholds};
use crate::{
    gantry::belts,
    recording::Split,
    twin::{CameraStage, Channel, DriveStage, Machine, Output, Session, Stage, Twin},
};
use std::ops::Range;

/// Longest tested delay (s).
const LONGEST_DELAY: f64 = 0.3;

/// Parts of a session that are compared, as fractions of its length.
const FIRST_PART: Range<f64> = 0.0..0.25;
const LAST_PART: Range<f64> = 0.75..1.0;

/// Time to which the threshold of a clock drift refers (s). In longer sessions a constant skew, which is an effect of
/// its own (`sensor.clock_skew`), shifts the latency by more.
const DRIFT_SPAN: f64 = 50.0;

/// Longest tested latency of a frame, either way (s), and its step (s).
const LONGEST_LATENCY: f64 = 1.0;
const LATENCY_STEP: f64 = 0.01;

/// Refusal of the data, with the way out.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Objection {
    /// Verdict of the refusal.
    pub verdict: Verdict,
    /// Reason, and the way out.
    pub says: String,
}

fn objection(verdict: Verdict, says: impl Into<String>) -> Option<Objection> {
    Some(Objection { verdict, says: says.into() })
}

/// First refusal of `sessions`, if any.
#[must_use]
pub fn check(sessions: &[Session], thresholds: &Thresholds) -> Option<Objection> {
    let time: f64 = sessions
        .iter()
        .flat_map(|session| &session.runs)
        .map(|run| run.span.end - run.span.start)
        .sum();
    // The samples of single axes are counted where they are compared.
    let is_table = sessions.iter().any(|session| session.axes.is_empty());
    if is_table && time < thresholds.min_time {
        return objection(
            Verdict::NotTestable,
            format!("{time:.1} s of runs are too short for a comparison; record at least 20 s"),
        );
    }
    if let Some(found) = check_directions(sessions, thresholds) {
        return Some(found);
    }
    for session in sessions {
        let found = match &session.drive {
            Some(drive) => check_drive(session, drive, thresholds),
            None if session.is_without_input() => objection(
                Verdict::NotTestable,
                format!(
                    "{} holds no commands: what moved the carriage is unknown; record \
                     /striker/*/command with it",
                    session.name
                ),
            ),
            None => None,
        };
        let camera = || {
            let own = session.camera.as_ref()?;
            check_camera(&session.name, own, thresholds)
        };
        let found = found.or_else(camera);
        if found.is_some() {
            return found;
        }
    }
    axis::check_axes(sessions, thresholds).or_else(|| check_splits(sessions))
}

/// Refusal without a training session.
fn check_splits(sessions: &[Session]) -> Option<Objection> {
    let is_fitted =
        |session: &Session| session.split == Split::Train && !session.stages().is_empty();
    if sessions.iter().any(is_fitted) {
        return None;
    }
    objection(
        Verdict::NotTestable,
        "every recording is marked split=validation, so nothing may be fitted; add a recording for training, or mark one \
         with split=train",
    )
}

/// Refusal where the search compared no signal.
pub(super) fn nothing_compared() -> Objection {
    Objection {
        verdict: Verdict::NotTestable,
        says: "no sample of any signal could be compared with the simulation; record longer, at a higher rate, or with \
               more motion"
            .to_owned(),
    }
}

/// Refusal of a search in which no selected effect can take part.
pub(super) fn nothing_selected(task: Task, machine: Machine) -> Objection {
    let says = match task {
        Task::Calibrate => {
            "the twin has none of the selected effects; select effects that it has, or find missing ones with \
             `klasktron gap`"
                .to_owned()
        }
        Task::CloseGap | Task::Follow => format!(
            "these recordings of a {machine} cannot show any selected effect; `klasktron effects --for RECORDING` lists \
             what they can show"
        ),
    };
    Objection { verdict: Verdict::NotTestable, says }
}

/// Refusal of the session `name` if the clocks of camera and encoders drift apart.
fn check_camera(name: &str, camera: &CameraStage, thresholds: &Thresholds) -> Option<Objection> {
    let latency = |part| latency_in(camera, part, thresholds.majority);
    let [(early, first), (late, last)] = [latency(FIRST_PART)?, latency(LAST_PART)?];
    let spans = ((last - first) / DRIFT_SPAN).max(1.0);
    if (late - early).abs() <= spans * thresholds.clock_drift {
        return None;
    }
    objection(
        Verdict::NotTestable,
        format!(
            "{name}: the camera shows where the carriage was {:.0} ms before at first and {:.0} ms before at the \
             end: the clocks drift; record camera and drives with one clock",
            1e3 * early,
            1e3 * late
        ),
    )
}

/// Latency at which the frames in a `part` of the session agree best with the carriage (s), and the middle of that part
/// (s). `None` where no latency explains the fraction `least` of its motion.
fn latency_in(camera: &CameraStage, part: Range<f64>, least: f64) -> Option<(f64, f64)> {
    let [x, y] = [camera.channels.first()?, camera.channels.get(1)?];
    let length = x.times.last()?;
    let seen: Vec<(f64, [f64; 2])> = x
        .times
        .iter()
        .zip(x.measured.iter().zip(&y.measured))
        .filter(|(time, (x, y))| {
            (part.start * length..part.end * length).contains(*time) && (*x + *y).is_finite()
        })
        .map(|(time, (x, y))| (*time, [*x, *y]))
        .collect();
    let whole = spread(seen.iter().map(|(_, place)| *place));
    let left = |latency: f64| {
        let mut cursor = 0;
        spread(seen.iter().map(|(time, place)| {
            let (carriage, ..) = camera.carriage.at(time - latency, &mut cursor);
            [place[0] - carriage[0], place[1] - carriage[1]]
        }))
    };
    let steps = (LONGEST_LATENCY / LATENCY_STEP).round() as i32;
    let latencies = (-steps..=steps).map(|step| LATENCY_STEP * f64::from(step));
    let (latency, off) = latencies
        .map(|latency| (latency, left(latency)))
        .min_by(|own, other| own.1.total_cmp(&other.1))?;
    let middle = 0.5 * (part.start + part.end) * length;
    (off < (1.0 - least) * whole).then_some((latency, middle))
}

/// Standard deviation of positions about their mean (m).
fn spread(positions: impl Iterator<Item = [f64; 2]>) -> f64 {
    let (mut count, mut sum, mut square) = (0.0, [0.0; 2], 0.0);
    for [x, y] in positions {
        count += 1.0;
        sum = [sum[0] + x, sum[1] + y];
        square += x * x + y * y;
    }
    let mean = sum.map(|own| own / f64::max(count, 1.0));
    (square / f64::max(count, 1.0) - mean[0] * mean[0] - mean[1] * mean[1]).max(0.0).sqrt()
}

/// Refusal of `twin` if a stage of `sessions` diverges with its parameters. Samples without a prediction would be
/// excluded, and no effect would seem to be missing.
#[must_use]
pub(super) fn check_twin(
    twin: &Twin,
    sessions: &[Session],
    thresholds: &Thresholds,
) -> Option<Objection> {
    sessions.iter().flat_map(Session::stages).find_map(|stage| {
        let signals = diverging_signals(twin, stage, thresholds.majority)?;
        let says = format!(
            "the twin predicts no finite {signals} for most of the recording: with its numbers the simulation diverges; \
             calibrate it anew with `klasktron calibrate`, or start without --twin"
        );
        objection(Verdict::NotTestable, says)
    })
}

/// Signals of `stage` whose simulation diverges: the twin predicts less than the fraction `least` of the samples that
/// the built-in one predicts.
fn diverging_signals(twin: &Twin, stage: &dyn Stage, least: f64) -> Option<String> {
    let compared = |twin: &Twin| -> usize {
        let predicted = problem::predict(stage, twin, &problem::starts(stage));
        let channels = stage.channels().iter().zip(&predicted);
        let finite = |(channel, values): (&Channel, &Vec<f64>)| {
            let pairs = channel.measured.iter().zip(values);
            pairs.filter(|(own, value)| own.is_finite() && value.is_finite()).count()
        };
        channels.map(finite).sum()
    };
    let measured = stage.channels().iter().flat_map(|own| &own.measured);
    let measured = measured.filter(|own| own.is_finite()).count();
    let found = compared(twin) as f64;
    let is_few = |possible: usize| found < least * possible as f64;
    // The built-in twin predicts at most the measured samples: it is simulated only where needed.
    let diverges = is_few(measured) && is_few(compared(&twin.plain()));
    let names: Vec<&str> = stage.channels().iter().map(|channel| channel.signal.as_str()).collect();
    diverges.then(|| names.join(", "))
}

/// Refusal if the motors of all training sessions together were driven in one direction only.
fn check_directions(sessions: &[Session], thresholds: &Thresholds) -> Option<Objection> {
    let train = sessions.iter().filter(|session| session.split == Split::Train);
    let commanded: Vec<f64> = train
        .filter_map(|session| session.drive.as_ref())
        .flat_map(|drive| Pairs::of(drive).commanded().collect::<Vec<f64>>())
        .collect();
    let standing = thresholds.min_fraction * rms(commanded.iter().copied());
    let count = |is_counted: &dyn Fn(f64) -> bool| {
        commanded.iter().filter(|value| is_counted(**value)).count() as f64
    };
    let forward = count(&|value| standing < value);
    let backward = count(&|value| value < -standing);
    if thresholds.min_fraction * (forward + backward) <= f64::min(forward, backward) {
        return None;
    }
    objection(
        Verdict::NotTestable,
        "the motors of the training sessions were driven in one direction only, so friction, offset and backlash cannot be \
         distinguished; record moves both ways, such as x_line and y_line",
    )
}

fn check_drive(
    session: &Session,
    drive: &DriveStage,
    thresholds: &Thresholds,
) -> Option<Objection> {
    let pairs = Pairs::of(drive);
    let name = &session.name;
    if pairs.commanded().all(|value| value == 0.0) {
        return objection(
            Verdict::NotTestable,
            format!("{name}: every command is zero; record runs in which the carriage is driven"),
        );
    }
    let commanded = rms(pairs.commanded());
    let moved = rms(pairs.moved());
    if moved < thresholds.min_fraction * commanded {
        return objection(
            Verdict::InputNotConnected,
            format!(
                "{name}: commands of {commanded:.3} m/s RMS were logged and the motors moved \
                 {moved:.4} m/s: they were off, or unplugged; arm the drives and record again"
            ),
        );
    }
    let best = pairs.best_delay(0.0..1.0);
    if best.1 < thresholds.min_fraction {
        return objection(
            Verdict::InputNotConnected,
            format!(
                "{name}: the command explains {:.0} % of the motion at any delay up to {LONGEST_DELAY} s: \
                 moved by hand, another source of commands, or clocks apart",
                100.0 * best.1.max(0.0)
            ),
        );
    }
    let (early, late) = (pairs.best_delay(FIRST_PART), pairs.best_delay(LAST_PART));
    if 0.5 < early.1.min(late.1) && thresholds.clock_drift < (late.0 - early.0).abs() {
        return objection(
            Verdict::NotTestable,
            format!(
                "{name}: motion follows the command by {:.0} ms at first and by {:.0} ms at the end: \
                 the clocks drift; record commands and motion with one clock",
                1e3 * early.0,
                1e3 * late.0
            ),
        );
    }
    None
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) =
        values.fold((0.0, 0_usize), |(sum, count), value| (sum + value * value, count + 1));
    (sum / count.max(1) as f64).sqrt()
}

/// Motor velocities with the command at any earlier time.
struct Pairs<'a> {
    drive: &'a DriveStage,
    /// Motor, time, velocity.
    samples: Vec<(usize, f64, f64)>,
}

impl<'a> Pairs<'a> {
    fn of(drive: &'a DriveStage) -> Self {
        let mut samples = Vec::new();
        for (channel, output) in drive.channels.iter().zip(&drive.outputs) {
            let Output::Velocity(motor) = *output else { continue };
            for sample in channel.runs.iter().flat_map(Clone::clone) {
                if channel.measured[sample].is_finite() {
                    samples.push((motor, channel.times[sample], channel.measured[sample]));
                }
            }
        }
        Self { drive, samples }
    }

    fn command(&self, motor: usize, time: f64) -> f64 {
        let sent_by = time - self.drive.arrivals[motor] + 1e-9;
        let after = self.drive.command_times.partition_point(|sent| *sent <= sent_by);
        after.checked_sub(1).map_or(0.0, |index| belts(self.drive.commands[index])[motor])
    }

    fn commanded(&self) -> impl Iterator<Item = f64> {
        self.samples.iter().map(|(motor, time, _)| self.command(*motor, *time))
    }

    fn moved(&self) -> impl Iterator<Item = f64> {
        self.samples.iter().map(|(.., velocity)| *velocity)
    }

    /// Delay at which the command explains most of the motion in a part of the session, and the explained fraction.
    fn best_delay(&self, part: Range<f64>) -> (f64, f64) {
        let length = self.samples.iter().map(|sample| sample.1).fold(0.0, f64::max);
        let own: Vec<&(usize, f64, f64)> = self
            .samples
            .iter()
            .filter(|sample| (part.start * length..part.end * length).contains(&sample.1))
            .collect();
        let total: f64 = own.iter().map(|sample| sample.2 * sample.2).sum();
        let mut best = (0.0, f64::NEG_INFINITY);
        for step in 0..=(LONGEST_DELAY / 0.005) as usize {
            let delay = step as f64 * 0.005;
            let (mut cross, mut square) = (0.0, 0.0);
            for (motor, time, velocity) in &own {
                let command = self.command(*motor, time - delay);
                cross += command * velocity;
                square += command * command;
            }
            let explained = cross.max(0.0).powi(2) / (square * total).max(f64::MIN_POSITIVE);
            if best.1 < explained {
                best = (delay, explained);
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{gap::test_stage::TestStage, twin::Machine};

    #[test]
    fn a_simulation_that_diverges_is_refused_and_one_that_is_right_is_not() {
        // The built-in twin always predicts something.
        let nominal = Twin::nominal(Machine::Table);
        let of_twin = |twin: &Twin, measured: f64, predicted: f64| {
            let predict = |twin: &Twin, _| if *twin == nominal { 0.0 } else { predicted };
            diverging_signals(twin, &TestStage::drive(vec![measured; 2], predict), 0.5)
        };
        let of = |measured, predicted| {
            of_twin(&Twin { striker_mass: 1.0, ..nominal.clone() }, measured, predicted)
        };
        assert_eq!(of(0.1, f64::NAN), Some("motor_a.velocity".to_owned()));
        assert_eq!(of(0.1, 0.1), None);
        // A sample without measurement needs no prediction.
        assert_eq!(of(f64::NAN, f64::NAN), None);
    }
}
