//! Options of sessions: validation data and masks that the user chooses.

use super::{Run, Session, SessionError};
use crate::recording::{Recording, Split};
use std::{fmt, ops::Range, str::FromStr};

/// Time that is excluded from fits and metrics.
#[derive(Debug, Clone, PartialEq)]
pub struct Mask {
    /// Session by name or file; `None` for all sessions.
    pub session: Option<String>,
    /// Start and end (s since the session began).
    pub span: Range<f64>,
}

impl FromStr for Mask {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let way_out =
            || "must be FROM..TO or SESSION:FROM..TO in seconds, such as 12.5..14".to_owned();
        let (session, span) = match text.rsplit_once(':') {
            Some((session, span)) => (Some(session.to_owned()), span),
            None => (None, text),
        };
        let (from, to) = span.split_once("..").ok_or_else(way_out)?;
        let seconds = |text: &str| text.trim().parse::<f64>().ok().filter(|own| 0.0 <= *own);
        let (from, to) = (seconds(from).ok_or_else(way_out)?, seconds(to).ok_or_else(way_out)?);
        if to <= from {
            return Err(format!("{from}..{to} is empty; FROM must be less than TO"));
        }
        Ok(Self { session, span: from..to })
    }
}

impl fmt::Display for Mask {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(session) = &self.session {
            write!(f, "{session}:")?;
        }
        write!(f, "{}..{}", self.span.start, self.span.end)
    }
}

/// Options of [`sessions_with`](super::sessions_with).
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SessionOptions {
    /// Sessions that are held out for validation, by name or file.
    pub validation: Vec<String>,
    /// Times that are excluded.
    pub masks: Vec<Mask>,
}

impl SessionOptions {
    /// Mark the runs of the validation sessions.
    ///
    /// # Errors
    /// A name is that of no recording.
    pub(super) fn divide(
        &self,
        recordings: &[Recording],
        runs: &mut [Vec<Run>],
    ) -> Result<(), SessionError> {
        for name in &self.validation {
            let mut found = false;
            for (recording, runs) in recordings.iter().zip(runs.iter_mut()) {
                if is_called(recording, name) {
                    runs.iter_mut().for_each(|run| run.split = Some(Split::Validation));
                    found = true;
                }
            }
            if !found {
                return Err(unknown(name, recordings));
            }
        }
        Ok(())
    }

    /// Exclude the masked times of `sessions`, which are of `recordings`.
    ///
    /// # Errors
    /// A name is that of no recording, or a mask lies behind the end of its session.
    pub(super) fn mask(
        &self,
        recordings: &[Recording],
        sessions: &mut [Session],
    ) -> Result<(), SessionError> {
        for mask in &self.masks {
            let is_meant = |recording: &&Recording| {
                mask.session.as_ref().is_none_or(|name| is_called(recording, name))
            };
            let meant: Vec<&str> = recordings
                .iter()
                .filter(is_meant)
                .map(|recording| recording.sha256.as_str())
                .collect();
            if let (Some(name), []) = (&mask.session, meant.as_slice()) {
                return Err(unknown(name, recordings));
            }
            let own = sessions.iter_mut().filter(|own| meant.contains(&own.sha256.as_str()));
            let mut longest = 0.0_f64;
            for session in own {
                longest = longest.max(session.length);
                session.exclude(&mask.span);
            }
            if longest <= mask.span.start {
                let mask = mask.to_string();
                return Err(SessionError::MaskBehindEnd { mask, length: longest });
            }
        }
        Ok(())
    }
}

/// Return whether `name` is the path of the recording, its file name, or the name of its session.
fn is_called(recording: &Recording, name: &str) -> bool {
    let file = recording.path.file_name().map(|file| file.to_string_lossy());
    let stem = recording.path.file_stem().map(|stem| stem.to_string_lossy());
    recording.path.display().to_string() == name
        || file.is_some_and(|file| file == name)
        || stem.is_some_and(|stem| stem == name)
        || recording.info("session") == Some(name)
}

fn unknown(name: &str, recordings: &[Recording]) -> SessionError {
    let known: Vec<String> = recordings.iter().map(super::session_name).collect();
    SessionError::UnknownSession { name: name.to_owned(), known: known.join(", ") }
}

impl Session {
    /// Exclude the samples in `span` (s since the session began) from fits and metrics.
    pub(super) fn exclude(&mut self, span: &Range<f64>) {
        let mut channels = Vec::new();
        channels.extend(self.drive.iter_mut().flat_map(|stage| stage.channels.iter_mut()));
        channels.extend(self.camera.iter_mut().flat_map(|stage| stage.channels.iter_mut()));
        channels.extend(self.estimator.iter_mut().flat_map(|stage| stage.channels_mut()));
        channels.extend(self.ball.iter_mut().flat_map(|stage| stage.channels_mut()));
        channels.extend(self.axes.iter_mut().flat_map(|stage| stage.channels_mut()));
        for channel in channels {
            let samples = channel.times.iter().zip(&mut channel.measured);
            samples.filter(|(time, _)| span.contains(*time)).for_each(|(_, own)| *own = f64::NAN);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mask_is_a_span_of_one_or_of_all_sessions() {
        let mask = |text: &str| text.parse::<Mask>();
        assert_eq!(mask("1.5..3"), Ok(Mask { session: None, span: 1.5..3.0 }));
        let of_one = Mask { session: Some("monday".to_owned()), span: 0.0..2.0 };
        assert_eq!(mask("monday:0..2"), Ok(of_one.clone()));
        assert_eq!(of_one.to_string(), "monday:0..2");
        for wrong in ["3", "a..b", "-1..2", "1..", "NaN..2"] {
            assert!(mask(wrong).unwrap_err().contains("FROM..TO"), "{wrong}");
        }
        assert!(mask("3..2").unwrap_err().contains("is empty"));
    }
}
