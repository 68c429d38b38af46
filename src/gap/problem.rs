//! Least-squares problem over several sessions of one stage: shared parameters, and nuisance parameters of a session or
//! a run, which are eliminated.

use super::{
    batch::{self, in_parallel},
    evidence::Blocks,
    incident::Incident,
    memo::{self, Memo},
    nuisance::{Elimination, eliminate},
    options::Context,
    outliers::without_spikes,
    thresholds::Thresholds,
    whiten::{self, Filter, Filters, Layout, Residual},
};
use crate::twin::{Machine, Slot, Stage, Twin};
use std::sync::OnceLock;

/// Number of the [long blocks](Problem::long_blocks) of a session: few, so that each contains whole motions, and enough for
/// a variance.
const LONG_BLOCKS: usize = 8;

/// One stage of one session with its measurements.
pub struct Part<'a> {
    /// Stage.
    pub stage: &'a dyn Stage,
    /// Samples that are used as rows.
    pub layout: Layout,
    /// One-off disturbances, which are excluded.
    pub incidents: Vec<Incident>,
    /// Time (s) by which commands reach each motor later than in the first training session, which is part of
    /// `drive.delay`.
    pub(super) late: [f64; 2],
    /// Rows of each nuisance group.
    pub(super) groups: Vec<std::ops::Range<usize>>,
    /// Earlier predictions.
    memo: Memo,
}

impl<'a> Part<'a> {
    /// Part with every finite sample that `stage` measured and `twin` predicts.
    #[must_use]
    pub fn new(stage: &'a dyn Stage, twin: &Twin) -> Self {
        let memo = Memo::default();
        let mut part = Self {
            stage,
            layout: Layout::default(),
            incidents: vec![],
            late: [0.0; 2],
            groups: vec![],
            memo,
        };
        let predicted = part.predict(twin, &starts(stage));
        let usable: Vec<Vec<bool>> = stage
            .channels()
            .iter()
            .zip(&predicted)
            .map(|(channel, values)| {
                channel
                    .measured
                    .iter()
                    .zip(values)
                    .map(|(measured, value)| measured.is_finite() && value.is_finite())
                    .collect()
            })
            .collect();
        part.count(&usable);
        part
    }

    /// Range of the position on which the phase of a wave depends; zero where it is not known.
    fn travel(&self) -> f64 {
        let positions = self.stage.phase_positions();
        let highest = positions.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let lowest = positions.iter().copied().fold(f64::INFINITY, f64::min);
        (highest - lowest).max(0.0)
    }

    /// Prediction of the stage for `twin`.
    #[must_use]
    pub(super) fn predict(&self, twin: &Twin, nuisance: &[Vec<f64>]) -> Vec<Vec<f64>> {
        self.predict_each(&[twin], nuisance).swap_remove(0)
    }

    /// Prediction of the stage for `twin`, with commands that reach each motor `late` (s).
    #[must_use]
    pub(super) fn predict_late(&self, twin: &Twin, late: [f64; 2]) -> Vec<Vec<f64>> {
        self.remembered_late(&[twin], late).swap_remove(0)
    }

    /// The same for each of `twins`. Commands that are not late need no simulation of their own.
    fn remembered_late(&self, twins: &[&Twin], late: [f64; 2]) -> Vec<Vec<Vec<f64>>> {
        match late {
            [0.0, 0.0] => self.remembered(twins, &[]),
            late => self.remembered(twins, &[late.to_vec()]),
        }
    }

    /// Predictions of the stage for each of `twins`: `[twin][channel][sample]`.
    #[must_use]
    fn predict_each(&self, twins: &[&Twin], nuisance: &[Vec<f64>]) -> Vec<Vec<Vec<f64>>> {
        if self.late != [0.0; 2] {
            return self.remembered_late(twins, self.late);
        }
        let Some(offsets) = self.stage.offsets(nuisance) else {
            return self.remembered(twins, nuisance);
        };
        let mut predicted = self.remembered(twins, &starts(self.stage));
        for channels in &mut predicted {
            for (channel, offset) in channels.iter_mut().zip(&offsets) {
                channel.iter_mut().for_each(|value| *value += offset);
            }
        }
        predicted
    }

    /// Predictions without offsets, each simulated once and then remembered.
    fn remembered(&self, twins: &[&Twin], nuisance: &[Vec<f64>]) -> Vec<Vec<Vec<f64>>> {
        let key = |twin: &&Twin| memo::key(twin, nuisance);
        let keys: Vec<memo::Key> = twins.iter().map(key).collect();
        let mut known: Vec<Option<_>> = keys.iter().map(|key| self.memo.get(key)).collect();
        let new: Vec<usize> = (0..twins.len()).filter(|own| known[*own].is_none()).collect();
        let asked: Vec<&Twin> = new.iter().map(|own| twins[*own]).collect();
        let predicted = batch::predict_each(self.stage, &asked, nuisance);
        for (index, predicted) in new.into_iter().zip(predicted) {
            self.memo.put(keys[index].clone(), &predicted);
            known[index] = Some(predicted);
        }
        known.into_iter().flatten().collect()
    }

    /// Use the samples `usable[channel][sample]` from now on, without one-off disturbances.
    fn count(&mut self, usable: &[Vec<bool>]) {
        let is_apart = |time: &f64| self.incidents.iter().all(|own| !own.span.contains(time));
        let usable: Vec<Vec<bool>> = self
            .stage
            .channels()
            .iter()
            .zip(usable)
            .map(|(channel, usable)| {
                let each = channel.times.iter().zip(usable);
                each.map(|(time, usable)| *usable && is_apart(time)).collect()
            })
            .collect();
        let layout = Layout::new(self.stage, &usable);
        self.groups = self
            .stage
            .nuisance_groups()
            .into_iter()
            .map(|runs| {
                if runs.is_empty() || layout.runs.is_empty() {
                    0..0
                } else {
                    layout.runs[runs.start].start..layout.runs[runs.end - 1].end
                }
            })
            .collect();
        self.layout = layout;
    }

    /// Residual, measured less predicted: `[channel][sample]`.
    #[must_use]
    pub fn residual(&self, predicted: &[Vec<f64>]) -> Vec<Vec<f64>> {
        difference(self.stage, predicted)
    }
}

fn difference(stage: &dyn Stage, predicted: &[Vec<f64>]) -> Vec<Vec<f64>> {
    stage
        .channels()
        .iter()
        .zip(predicted)
        .map(|(channel, values)| channel.measured.iter().zip(values).map(|(m, p)| m - p).collect())
        .collect()
}

/// First guesses of the nuisance parameters of a stage.
#[must_use]
pub(super) fn starts(stage: &dyn Stage) -> Vec<Vec<f64>> {
    (0..stage.nuisance_groups().len()).map(|group| stage.nuisance_start(group)).collect()
}

/// Prediction of the stage.
#[must_use]
pub(super) fn predict(stage: &dyn Stage, twin: &Twin, nuisance: &[Vec<f64>]) -> Vec<Vec<f64>> {
    batch::predict_each(stage, &[twin], nuisance).swap_remove(0)
}

/// Whitened residual and columns of all parts at one point, nuisances eliminated.
pub struct Linear {
    /// Whitened residual, part by part, without its component along the nuisance columns.
    pub residual: Vec<f64>,
    /// Whitened derivative by each scaled shared parameter, without its component along the nuisance columns.
    pub columns: Vec<Vec<f64>>,
    /// Block of each row, counted through all parts.
    pub(super) blocks: Blocks,
    /// Orthonormal nuisance columns by part and group, to move the nuisances with a step.
    eliminations: Vec<Vec<Elimination>>,
}

/// Prediction of a twin: `[part][channel][sample]`.
pub(super) type Prediction = Vec<Vec<Vec<f64>>>;

/// Several sessions of one stage.
pub struct Problem<'a> {
    /// Sessions.
    pub parts: Vec<Part<'a>>,
    /// Options and observer of the search.
    pub context: Context<'a>,
    /// Range of the position on which the phase of a wave depends, once it was asked for.
    travel: OnceLock<f64>,
}

/// Point with its prediction.
#[derive(Debug, Clone)]
pub(super) struct Evaluated {
    pub(super) point: Point,
    pub(super) prediction: Prediction,
}

/// Twin with the nuisance parameters of each part.
#[derive(Debug, Clone)]
pub struct Point {
    /// Twin.
    pub twin: Twin,
    /// Nuisance parameters: `[part][group][parameter]`.
    pub nuisance: Vec<Vec<Vec<f64>>>,
}

/// Longest period of a wave along a position that is scanned for, in ranges of that position. A motor of a table makes
/// many turns in its travel; the arm on a single axis may make less than one.
pub(super) fn longest_in_travels(machine: Machine) -> f64 {
    match machine {
        Machine::Table => 0.5,
        Machine::Axis => 4.0,
    }
}

impl<'a> Problem<'a> {
    /// Problem of `stages`, on all samples that `twin` can predict.
    #[must_use]
    pub fn new(stages: &[&'a dyn Stage], twin: &Twin) -> Self {
        let parts = stages.iter().map(|stage| Part::new(*stage, twin)).collect();
        Self { parts, context: Context::default(), travel: OnceLock::new() }
    }

    /// Longest period of a wave along the position that is scanned for, in the unit of the position; infinite where the
    /// position is not known. A fit of a longer one describes a bend.
    pub(super) fn longest_period(&self, machine: Machine) -> f64 {
        let travel = || {
            let travels = self.parts.iter().map(Part::travel);
            travels.reduce(f64::max).filter(|travel| 0.0 < *travel).unwrap_or(f64::INFINITY)
        };
        longest_in_travels(machine) * *self.travel.get_or_init(travel)
    }

    /// The same problem in the `context` of a search.
    #[must_use]
    pub fn within(self, context: Context<'a>) -> Self {
        Self { context, ..self }
    }

    /// Thresholds of the search.
    #[must_use]
    pub(super) fn thresholds(&self) -> &'a Thresholds {
        self.context.options.thresholds()
    }

    /// `twin` with first guesses of all nuisances.
    #[must_use]
    pub fn start(&self, twin: Twin) -> Point {
        let nuisance = self.parts.iter().map(|part| starts(part.stage)).collect();
        Point { twin, nuisance }
    }

    /// Number of rows of all parts.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.parts.iter().map(|part| part.layout.rows.len()).sum()
    }

    /// Prediction of the twin at `point`.
    #[must_use]
    pub(super) fn prediction(&self, point: &Point) -> Prediction {
        self.parts
            .iter()
            .zip(&point.nuisance)
            .map(|(part, nuisance)| part.predict(&point.twin, nuisance))
            .collect()
    }

    /// `point` with its prediction.
    #[must_use]
    pub(super) fn evaluated(&self, point: Point) -> Evaluated {
        let prediction = self.prediction(&point);
        Evaluated { point, prediction }
    }

    /// Residuals of all parts: `[part][channel][sample]`.
    #[must_use]
    pub fn residuals(&self, point: &Point) -> Vec<Vec<Vec<f64>>> {
        let prediction = self.prediction(point);
        self.parts.iter().zip(&prediction).map(|(part, own)| part.residual(own)).collect()
    }

    /// Filters from the residuals at `point`.
    #[must_use]
    pub fn filters(&self, point: &Point, fit: fn(&[Residual<'_>]) -> Filters) -> Filters {
        let residuals = self.residuals(point);
        let parts: Vec<Residual<'_>> = self
            .parts
            .iter()
            .zip(&residuals)
            .map(|(part, residual)| (part.stage, &part.layout, residual.as_slice()))
            .collect();
        fit(&parts)
    }

    /// Whitened residual of all parts, nuisances unchanged.
    #[must_use]
    pub fn whitened(&self, point: &Point, filters: &Filters) -> Vec<f64> {
        self.whitened_at(&self.prediction(point), filters)
    }

    /// Whitened residual of a prediction.
    #[must_use]
    pub(super) fn whitened_at(&self, prediction: &Prediction, filters: &Filters) -> Vec<f64> {
        let mut all = Vec::with_capacity(self.rows());
        for (part, own) in self.parts.iter().zip(prediction) {
            let order = whiten::in_order(part.stage, filters);
            all.extend(part.layout.whitened(&part.residual(own), &order));
        }
        all
    }

    /// Residual and columns at `point`, by one-sided finite differences of the simulation. Columns
    /// are per scaled parameter: a change of one is `scale` of the parameter.
    #[must_use]
    pub fn linear(&self, point: &Point, slots: &[Slot], filters: &Filters) -> Linear {
        let at = self.evaluated(point.clone());
        let columns = self.columns(&at, slots, filters);
        self.linear_of(&at, columns, filters)
    }

    /// Whitened derivative by each scaled parameter, nuisances unchanged.
    #[must_use]
    pub(super) fn columns(
        &self,
        at: &Evaluated,
        slots: &[Slot],
        filters: &Filters,
    ) -> Vec<Vec<f64>> {
        let point = &at.point;
        let variants: Vec<Twin> = slots
            .iter()
            .map(|slot| {
                let mut twin = point.twin.clone();
                twin.nudge(*slot);
                twin
            })
            .collect();
        let mut columns = self.contrasts(at, &variants, filters);
        for ((column, slot), twin) in columns.iter_mut().zip(slots).zip(&variants) {
            let step = (twin.get(*slot) - point.twin.get(*slot)) / point.twin.scale(*slot);
            let factor = if step == 0.0 { 0.0 } else { 1.0 / step };
            column.iter_mut().for_each(|value| *value *= factor);
        }
        columns
    }

    /// Whitened change of the prediction from a point (`at`) to each of `variants`, nuisances unchanged.
    #[must_use]
    pub(super) fn contrasts(
        &self,
        at: &Evaluated,
        variants: &[Twin],
        filters: &Filters,
    ) -> Vec<Vec<f64>> {
        let orders: Vec<Vec<Filter>> =
            self.parts.iter().map(|part| whiten::in_order(part.stage, filters)).collect();
        let twins: Vec<&Twin> = variants.iter().collect();
        let mut columns = vec![Vec::with_capacity(self.rows()); variants.len()];
        for (index, part) in self.parts.iter().enumerate() {
            let predicted = part.predict_each(&twins, &at.point.nuisance[index]);
            for (column, mut change) in columns.iter_mut().zip(predicted) {
                for (values, from) in change.iter_mut().zip(&at.prediction[index]) {
                    values.iter_mut().zip(from).for_each(|(value, from)| *value -= from);
                }
                column.extend(part.layout.whitened(&change, &orders[index]));
            }
        }
        for column in &mut columns {
            // A variant whose simulation diverges gives no information.
            if column.iter().any(|value| !value.is_finite()) {
                column.fill(0.0);
            }
        }
        columns
    }

    /// Linearization at an evaluated point with known `columns`: the nuisance directions are projected out of them and
    /// of the residual.
    pub(super) fn linear_of(
        &self,
        at: &Evaluated,
        mut columns: Vec<Vec<f64>>,
        filters: &Filters,
    ) -> Linear {
        let mut residual = self.whitened_at(&at.prediction, filters);
        let mut eliminations = Vec::with_capacity(self.parts.len());
        let mut first_row = 0;
        for (index, part) in self.parts.iter().enumerate() {
            let nuisance = self.nuisance_columns(at, index, filters);
            let mut of_part = Vec::new();
            for group in &part.groups {
                let rows = first_row + group.start..first_row + group.end;
                let local: Vec<Vec<f64>> =
                    nuisance.iter().map(|column| column[group.clone()].to_vec()).collect();
                of_part.push(eliminate(rows, local, &mut residual, &mut columns));
            }
            eliminations.push(of_part);
            first_row += part.layout.rows.len();
        }
        Linear { residual, columns, blocks: self.blocks(), eliminations }
    }

    /// Whitened derivative of part `index` by each nuisance parameter, all groups moved at once.
    fn nuisance_columns(&self, at: &Evaluated, index: usize, filters: &Filters) -> Vec<Vec<f64>> {
        let point = &at.point;
        let part = &self.parts[index];
        let scales = part.stage.nuisance_scale();
        if part.groups.is_empty() {
            return Vec::new();
        }
        let order = whiten::in_order(part.stage, filters);
        let parameters: Vec<usize> = (0..scales.len()).collect();
        in_parallel(&parameters, |number| {
            let step = 1e-3 * scales[*number];
            let mut moved = point.nuisance[index].clone();
            moved.iter_mut().for_each(|group| group[*number] += step);
            let mut change = part.predict(&point.twin, &moved);
            for (values, from) in change.iter_mut().zip(&at.prediction[index]) {
                for (value, from) in values.iter_mut().zip(from) {
                    *value = (*value - from) / step;
                }
            }
            part.layout.whitened(&change, &order)
        })
    }

    /// `point` after a `step` of the shared parameters (scaled), and of the nuisances with them; and the step itself,
    /// which bounds may have limited.
    #[must_use]
    pub(super) fn moved(
        &self,
        point: &Point,
        slots: &[Slot],
        step: &[f64],
        linear: &Linear,
    ) -> (Point, Vec<f64>) {
        let mut next = point.clone();
        let mut taken = vec![0.0; step.len()];
        for ((slot, change), taken) in slots.iter().zip(step).zip(&mut taken) {
            let scale = point.twin.scale(*slot);
            next.twin.set(*slot, point.twin.get(*slot) + change * scale);
            *taken = (next.twin.get(*slot) - point.twin.get(*slot)) / scale;
        }
        for (groups, eliminations) in next.nuisance.iter_mut().zip(&linear.eliminations) {
            for (group, elimination) in groups.iter_mut().zip(eliminations) {
                for (number, change) in group.iter_mut().zip(elimination.change(&taken)) {
                    *number += change;
                }
            }
        }
        (next, taken)
    }
}

impl Linear {
    /// Project all nuisance directions out of one more column.
    pub fn take_nuisances_from(&self, column: &mut [f64]) {
        for elimination in self.eliminations.iter().flatten() {
            elimination.take_from(column);
        }
    }
}

/// Scalar product, as a fixed number of sums that do not wait for each other: the same bytes on any processor.
#[must_use]
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    const SUMS: usize = 16;
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<SUMS>(), b.as_chunks::<SUMS>());
    let mut sums = [0.0; SUMS];
    for (a, b) in a.iter().zip(b) {
        for (sum, (a, b)) in sums.iter_mut().zip(a.iter().zip(b)) {
            *sum += a * b;
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f64>() + rest
}

impl Problem<'_> {
    /// Exclude outliers: single samples far from their neighbours in the residual at `point`.
    pub fn drop_outliers(&mut self, point: &Point) {
        let nuisance: Vec<Vec<Vec<f64>>> =
            self.parts.iter().zip(&point.nuisance).map(|(_, nuisance)| nuisance.clone()).collect();
        let ratio = self.thresholds().outlier_ratio;
        for (part, nuisance) in self.parts.iter_mut().zip(nuisance) {
            let residual = part.residual(&part.predict(&point.twin, &nuisance));
            let usable: Vec<Vec<bool>> =
                residual.iter().map(|values| without_spikes(values, ratio)).collect();
            part.count(&usable);
        }
    }

    /// Block of each row, counted through all parts.
    #[must_use]
    pub(super) fn blocks(&self) -> Blocks {
        self.blocks_of(|layout| layout.blocks)
    }

    /// The same with [`LONG_BLOCKS`] equal blocks in each part.
    #[must_use]
    pub(super) fn long_blocks(&self) -> Blocks {
        self.blocks_of(|layout| layout.blocks.min(LONG_BLOCKS))
    }

    /// Blocks of each part: the blocks of its layout, evenly joined to `count` of them.
    fn blocks_of(&self, count: impl Fn(&Layout) -> usize) -> Blocks {
        let mut blocks = Blocks::default();
        for part in &self.parts {
            let Layout { rows, blocks: all, .. } = &part.layout;
            let own = count(&part.layout);
            let joined = |block: u32| block as usize * own / (*all).max(1);
            blocks.of_row.extend(rows.iter().map(|row| blocks.count + joined(row.block)));
            blocks.count += own;
        }
        blocks
    }

    /// Residual RMS of each signal at `point`, over all parts, in the order of the first part's
    /// channels.
    #[must_use]
    pub fn rms(&self, point: &Point) -> Vec<f64> {
        let mean = |(sum, count): (f64, usize)| (sum / count.max(1) as f64).sqrt();
        self.squares(point).into_iter().map(mean).collect()
    }

    /// Sum of the squared residuals of each signal, and their number.
    pub(super) fn squares(&self, point: &Point) -> Vec<(f64, usize)> {
        let Some(first) = self.parts.first() else { return Vec::new() };
        let mut sums = vec![(0.0, 0_usize); first.stage.channels().len()];
        for (part, residual) in self.parts.iter().zip(self.residuals(point)) {
            for row in &part.layout.rows {
                let value = residual[row.channel as usize][row.sample as usize];
                if let Some(sum) = sums.get_mut(row.channel as usize) {
                    sum.0 += value * value;
                    sum.1 += 1;
                }
            }
        }
        sums
    }
}

#[cfg(test)]
mod tests {
    use super::dot;

    #[test]
    fn a_scalar_product_takes_every_element_once() {
        for length in [0, 1, 15, 16, 17, 40] {
            let a: Vec<f64> = (0..length).map(f64::from).collect();
            let b: Vec<f64> = (0..length).map(|k| f64::from(2 * k + 1)).collect();
            let sum: i32 = (0..length).map(|k| k * (2 * k + 1)).sum();
            assert_eq!(dot(&a, &b), f64::from(sum), "{length}");
        }
    }
}
