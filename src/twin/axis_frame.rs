//! Coordinate and typical magnitudes of a single axis, from the recordings to which its twin is
//! fitted.

use super::{AxisStage, Machine, Session, Source, Twin, machine_of};
use crate::{
    effects::{AxisScales, Effect},
    recording::Split,
};
use std::ops::Range;

/// Coordinate of a single axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisFrame {
    /// Position from which the positions in effects count, in the unit of the position: the middle of the range to which
    /// the twin was first fitted.
    pub position_origin: f64,
    /// Typical magnitudes.
    pub scales: AxisScales,
}

/// Sums over the samples of an axis in motion, from which the typical magnitudes follow.
#[derive(Debug, Clone)]
pub(super) struct MotionSums {
    pub(super) positions: Range<f64>,
    /// Sums of squares of input, velocity and acceleration.
    pub(super) squares: [f64; 3],
    pub(super) count: f64,
    pub(super) sample_period: f64,
    /// Highest frequency that is compared (Hz).
    pub(super) band: f64,
    pub(super) duration: f64,
}

impl MotionSums {
    fn and(self, other: &Self) -> Self {
        Self {
            positions: self.positions.start.min(other.positions.start)
                ..self.positions.end.max(other.positions.end),
            squares: [0, 1, 2].map(|k| self.squares[k] + other.squares[k]),
            count: self.count + other.count,
            sample_period: self.sample_period.min(other.sample_period),
            band: self.band.min(other.band),
            duration: self.duration.max(other.duration),
        }
    }
}

/// Frame of the training sessions' `axes`; `None` without motion or input.
fn frame_of(axes: &[&AxisStage]) -> Option<AxisFrame> {
    let first = axes.first()?;
    let sums =
        axes.iter().skip(1).fold(first.motion_sums(), |all, own| all.and(&own.motion_sums()));
    let [input, velocity, acceleration] = sums.squares.map(|square| (square / sums.count).sqrt());
    let MotionSums { positions, sample_period, band, duration, .. } = sums;
    let position = 0.5 * (positions.end - positions.start);
    let (input_unit, position_unit) = first.units();
    let sizes = [input, position, velocity, acceleration, sample_period, duration];
    let is_usable = sizes.iter().all(|size| size.is_finite() && 0.0 < *size);
    is_usable.then_some(AxisFrame {
        position_origin: 0.5 * (positions.end + positions.start),
        scales: AxisScales {
            input,
            position,
            velocity,
            acceleration,
            sample_period,
            band,
            duration,
            input_unit,
            position_unit,
        },
    })
}

impl Twin {
    /// The twin in the frame of the single axis of `sessions`, with the catalogue in its units. A
    /// twin without an origin of its positions gets that of the training sessions. A table, and an
    /// axis that does not move, have no frame.
    #[must_use]
    pub fn framed(self, sessions: &[Session]) -> Self {
        if self.machine != Machine::Axis || machine_of(sessions) != Machine::Axis {
            return self;
        }
        let train = sessions.iter().filter(|session| session.split == Split::Train);
        let axes: Vec<&AxisStage> = train.flat_map(|session| &session.axes).collect();
        match frame_of(&axes) {
            Some(frame) => self.in_frame(frame),
            None => self,
        }
    }

    fn in_frame(mut self, frame: AxisFrame) -> Self {
        for instance in &mut self.instances {
            let before = instance.effect;
            instance.effect = before.on_axis(&frame.scales);
            // Start values of the plain twin are those of the table.
            if self.axis_frame.is_none() {
                let scales = before.parameters.iter().zip(instance.effect.parameters);
                for (value, (old, new)) in instance.values.iter_mut().zip(scales) {
                    if value.source == Source::Nominal {
                        value.value *= new.scale / old.scale;
                    }
                }
            }
        }
        let own = self.axis_frame.map_or(frame.position_origin, |own| own.position_origin);
        self.axis_frame = Some(AxisFrame { position_origin: own, ..frame });
        self
    }

    /// Forms of `effect` on the machine, in its units.
    #[must_use]
    pub fn forms_of(&self, effect: &'static Effect) -> Vec<&'static Effect> {
        match self.axis_frame {
            Some(AxisFrame { scales, .. }) => {
                effect.forms_on_axis().into_iter().map(|form| form.on_axis(&scales)).collect()
            }
            None => vec![effect],
        }
    }

    /// The form of `effect` on the machine that has all parameters called `names`, else the first one; in its units.
    #[must_use]
    pub fn form_of<'n>(
        &self,
        effect: &'static Effect,
        names: impl IntoIterator<Item = &'n str> + Clone,
    ) -> &'static Effect {
        let on_axis = |frame: AxisFrame| effect.form_on_axis(names).on_axis(&frame.scales);
        self.axis_frame.map_or(effect, on_axis)
    }

    /// Position from which the positions in effects count.
    pub(crate) fn position_origin(&self) -> f64 {
        self.axis_frame.map_or(0.0, |frame| frame.position_origin)
    }
}
