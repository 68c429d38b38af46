//! Import of the raw logs of BAM, the test bench of Rhoban for servo actuators: a weight on an arm that a
//! position-controlled servo swings.
//!
//! A log is one JSON object with `mass` (kg), `length` (m), `motor`, `trajectory` and `entries`. Each entry has
//! `timestamp` (s), `position` (rad), and, as far as the servo reports them, `speed` (rad/s), `load` (duty), `input_volts`
//! (V) and `torque_enable`. The input of the axis is the motor's voltage: duty times supply. Entries with the motor off
//! are left out, because an open motor is not one with 0 V.
//!
//! Source: the recorders in `bam/*/record.py` of <https://github.com/Rhoban/bam> (field names and units, not code).

use super::{
    error::ImportError,
    report::{ImportReport, Notice},
    run::{ImportConfig, identity},
    tape::{Outgoing, Tape},
};
use crate::{
    recording::{
        message::{AxisInput, AxisOutput},
        topic,
    },
    units::Nanos,
};
use serde::Deserialize;
use std::{fs, path::Path};

/// Largest signed 16-bit number: recorders that read a register without its sign give larger ones for negative duty.
const LARGEST_SIGNED: f64 = 32_767.0;
/// Numbers of a 16-bit register.
const REGISTER: f64 = 65_536.0;

#[derive(Deserialize)]
struct Log {
    mass: Option<f64>,
    length: Option<f64>,
    kp: Option<f64>,
    vin: Option<f64>,
    motor: Option<String>,
    trajectory: Option<String>,
    entries: Vec<Entry>,
}

#[derive(Deserialize)]
struct Entry {
    timestamp: f64,
    position: f64,
    speed: Option<f64>,
    load: Option<f64>,
    input_volts: Option<f64>,
    #[serde(default = "enabled")]
    torque_enable: bool,
}

fn enabled() -> bool {
    true
}

impl Entry {
    /// Load with its sign.
    fn signed_load(&self) -> Option<f64> {
        self.load.map(|load| if LARGEST_SIGNED < load { load - REGISTER } else { load })
    }
}

/// Import the raw log at `path` as the axis `axis`. `full_load` is the load at full duty: 1 where the recorder has
/// divided by it.
///
/// # Errors
/// When the file is no such log, a voltage cannot be computed, a number is not finite, times do not increase, or a file
/// cannot be read or written.
pub fn import_bam(
    path: &Path,
    axis: &str,
    full_load: Option<f64>,
    config: &ImportConfig,
) -> Result<ImportReport, ImportError> {
    config.check_output()?;
    let bad = |reason: String| ImportError::Bam { path: path.to_owned(), reason };
    let bytes = fs::read(path).map_err(ImportError::io(path, "read"))?;
    let log: Log = serde_json::from_slice(&bytes).map_err(|error| bad(error.to_string()))?;
    let full_load = full_load.map_or_else(|| assumed_full_load(&log), Ok).map_err(bad)?;
    let mut tape = Tape::default();
    let (input_topic, output_topic) = (topic::axis_input(axis), topic::axis_output(axis));
    let mut previous: Option<f64> = None;
    let mut off = 0;
    for (index, entry) in log.entries.iter().enumerate() {
        let time = entry.timestamp;
        if previous.is_some_and(|previous| time <= previous) || !time.is_finite() {
            let before = previous.unwrap_or(0.0);
            return Err(bad(format!(
                "entry {index}: time {time} s does not come after {before} s"
            )));
        }
        previous = Some(time);
        if !entry.torque_enable {
            off += 1;
            continue;
        }
        let volts = voltage(entry, &log, full_load)
            .map_err(|what| bad(format!("entry {index}: {what}")))?;
        let stamp = Nanos(0).after_seconds(time - log.entries[0].timestamp);
        let input = AxisInput { value: volts, unit: "V".to_owned() };
        let output = AxisOutput {
            position: Some(entry.position),
            velocity: entry.speed,
            position_unit: "rad".to_owned(),
        };
        tape.push(&input_topic, stamp, Outgoing::AxisInput(input));
        tape.push(&output_topic, stamp, Outgoing::AxisOutput(output));
    }
    if off == log.entries.len() {
        let found = format!("the motor is off in all of its {off} entries");
        return Err(ImportError::NothingToImport { path: path.to_owned(), found });
    }
    if 0 < off {
        tape.notices.push(Notice::MotorOff { entries: off });
    }
    let split = config.split_or_train();
    tape.mark_run(0, log.trajectory.as_deref().unwrap_or("unknown"), &split.to_string());
    let mut config = config.clone();
    config.robot = config.robot.or_else(|| log.motor.clone());
    for (key, value) in
        [("bam_mass_kg", log.mass), ("bam_length_m", log.length), ("bam_kp", log.kp)]
    {
        if let Some(value) = value {
            tape.metadata.insert(key.to_owned(), value.to_string());
        }
    }
    config.write(tape, path, split, &[identity(path)?])
}

/// Load at full duty where the user gives none: 1, unless a load is larger.
fn assumed_full_load(log: &Log) -> Result<f64, String> {
    let loads = log.entries.iter().filter_map(Entry::signed_load);
    let largest = loads.fold(0.0_f64, |largest, load| largest.max(load.abs()));
    if largest <= 1.0 {
        return Ok(1.0);
    }
    Err(format!(
        "its loads reach {largest}, so they are no duty from -1 to 1; give the load at full duty with --full-load, such \
         as 885 for a Dynamixel XL330"
    ))
}

/// Voltage of the motor (V).
fn voltage(entry: &Entry, log: &Log, full_load: f64) -> Result<f64, String> {
    let load = entry.signed_load().ok_or("no load, so the voltage of the motor is unknown")?;
    let supply = entry.input_volts.or(log.vin).ok_or("no input_volts, and the log has no vin")?;
    let volts = load / full_load * supply;
    let finite =
        [volts, entry.position, entry.speed.unwrap_or(0.0)].iter().all(|own| own.is_finite());
    if finite { Ok(volts) } else { Err("a number that is not finite".to_owned()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::{ExistingFile, Recording};

    fn entry(time: f64, load: f64, more: &str) -> String {
        format!(
            "{{\"timestamp\": {time}, \"position\": 0.1, \"speed\": 0.5, \"load\": {load}, \"input_volts\": 7.0, \
             \"goal_position\": 0.2{more}}}"
        )
    }

    fn import(
        entries: &[String],
        full_load: Option<f64>,
    ) -> Result<(ImportReport, Recording), ImportError> {
        let folder = tempfile::tempdir().unwrap();
        let (log, output) = (folder.path().join("log.json"), folder.path().join("log.mcap"));
        let text = format!(
            "{{\"mass\": 0.49, \"length\": 0.1, \"kp\": 100, \"motor\": \"xl330\", \"trajectory\": \"sin_sin\", \
             \"entries\": [{}]}}",
            entries.join(", ")
        );
        fs::write(&log, text).unwrap();
        let config = ImportConfig::new(&output, ExistingFile::Refuse);
        let report = import_bam(&log, "servo", full_load, &config)?;
        Ok((report, Recording::open(&output).unwrap()))
    }

    #[test]
    fn voltage_is_duty_times_supply_and_entries_with_the_motor_off_are_left_out() {
        let off = ", \"torque_enable\": false";
        let entries = [entry(5.0, 0.5, ""), entry(5.1, 0.5, off), entry(5.2, -0.25, "")];
        let (report, recording) = import(&entries, None).unwrap();
        let inputs = recording.series::<AxisInput>("/axis/servo/input").unwrap();
        assert_eq!(inputs.values.iter().map(|own| own.value).collect::<Vec<_>>(), [3.5, -1.75]);
        assert_eq!(inputs.times, [Nanos(0), Nanos(200_000_000)]);
        let outputs = recording.series::<AxisOutput>("/axis/servo/output").unwrap();
        assert_eq!(
            (outputs.values[0].position, outputs.values[0].velocity),
            (Some(0.1), Some(0.5))
        );
        assert_eq!(outputs.values[0].position_unit, "rad");
        assert_eq!(recording.info("robot"), Some("xl330"));
        assert_eq!(recording.info("bam_length_m"), Some("0.1"));
        assert_eq!(recording.marked_runs().unwrap()[0].pattern, "sin_sin");
        assert_eq!(report.notices, [Notice::MotorOff { entries: 1 }]);
        assert!(!report.is_lossy());
    }

    #[test]
    fn counts_of_a_register_need_their_full_scale() {
        let entries = [entry(0.0, 442.5, ""), entry(0.1, 65_536.0 - 885.0, "")];
        let error = import(&entries, None).unwrap_err().to_string();
        assert!(
            error.contains("its loads reach 885, ") && error.contains("--full-load"),
            "{error}"
        );
        let (_, recording) = import(&entries, Some(885.0)).unwrap();
        let inputs = recording.series::<AxisInput>("/axis/servo/input").unwrap();
        assert_eq!(inputs.values.iter().map(|own| own.value).collect::<Vec<_>>(), [3.5, -7.0]);
    }

    #[test]
    fn faults_say_which_entry() {
        let error = |entries: &[String]| import(entries, None).unwrap_err().to_string();
        let twice = error(&[entry(0.0, 0.0, ""), entry(0.0, 0.0, "")]);
        assert!(twice.contains("entry 1: time 0 s does not come after 0 s"), "{twice}");
        let off = error(&[entry(0.0, 0.0, ", \"torque_enable\": false")]);
        assert!(off.contains("the motor is off in all of its 1 entries"), "{off}");
        let without = "{\"timestamp\": 0.0, \"position\": 0.1, \"input_volts\": 7.0}".to_owned();
        assert!(error(&[without]).contains("entry 0: no load"));
        assert!(error(&["{}".to_owned()]).contains("missing field `timestamp`"));
        assert!(error(&[]).contains("in all of its 0 entries"));
    }
}
