//! Values of several independent simulations side by side, one in each lane of a vector.
//!
//! Every operation is that of `f64` in each lane, rounded alike: no multiplication is fused with an
//! addition, and no sum runs across lanes. A simulation therefore gives the same bytes in any lane,
//! next to any other simulations, at any vector width.
//!
//! The operators are generic over [`Simd`]: with [`pulp::Scalar`] they are those of one `f64`. All
//! is inlined into the caller, which alone is compiled for the instructions of the processor.

mod sine;

use pulp::{Arch, Scalar, Simd, WithSimd, bytemuck};
use std::ops::{Add, BitAnd, Div, Mul, Neg, Sub};

/// Number of lanes on this processor.
pub(crate) fn width() -> usize {
    struct Width;

    impl WithSimd for Width {
        type Output = usize;

        #[inline(always)]
        fn with_simd<S: Simd>(self, _simd: S) -> usize {
            S::F64_LANES
        }
    }

    Arch::new().dispatch(Width)
}

/// Simulation of several items at once.
pub(crate) trait SideBySide {
    type Item;

    /// Simulate at most as many items as `simd` has lanes. Implementations are `#[inline(always)]`.
    fn run<S: Simd>(&mut self, simd: S, items: &mut [Self::Item]);
}

/// Simulate all `items`, as many at once as there are lanes.
pub(crate) fn side_by_side<W: SideBySide>(work: &mut W, items: &mut [W::Item]) {
    struct Dispatched<'w, W: SideBySide>(&'w mut W, &'w mut [W::Item]);

    impl<W: SideBySide> WithSimd for Dispatched<'_, W> {
        type Output = ();

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            self.0.run(simd, self.1);
        }
    }

    let lanes = width();
    // A vector takes about as long as a quarter of its lanes one after the other.
    let few = lanes.div_ceil(4);
    for items in items.chunks_mut(lanes) {
        if items.len() <= few {
            items.chunks_mut(1).for_each(|item| Dispatched(&mut *work, item).with_simd(Scalar));
        } else {
            Arch::new().dispatch(Dispatched(&mut *work, items));
        }
    }
}

/// One value of each simulation.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lanes<S: Simd> {
    simd: S,
    all: S::f64s,
}

/// One truth value of each simulation.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Mask<S: Simd> {
    simd: S,
    all: S::m64s,
}

impl<S: Simd> Lanes<S> {
    /// The same `value` in all lanes.
    #[inline(always)]
    pub(crate) fn splat(simd: S, value: f64) -> Self {
        Self { simd, all: simd.splat_f64s(value) }
    }

    /// The same `value` in all lanes, as many as there are here.
    #[inline(always)]
    pub(crate) fn like(self, value: f64) -> Self {
        Self::splat(self.simd, value)
    }

    /// The value `of` each lane.
    #[inline(always)]
    pub(crate) fn from_fn(simd: S, mut of: impl FnMut(usize) -> f64) -> Self {
        let mut lanes = Self::splat(simd, 0.0);
        for lane in 0..S::F64_LANES {
            lanes.set(lane, of(lane));
        }
        lanes
    }

    /// The value in `lane`.
    #[inline(always)]
    pub(crate) fn get(&self, lane: usize) -> f64 {
        bytemuck::cast_slice(std::slice::from_ref(&self.all))[lane]
    }

    /// Replaces the value in `lane`.
    #[inline(always)]
    pub(crate) fn set(&mut self, lane: usize, value: f64) {
        bytemuck::cast_slice_mut(std::slice::from_mut(&mut self.all))[lane] = value;
    }

    #[inline(always)]
    pub(crate) fn abs(self) -> Self {
        Self { all: self.simd.abs_f64s(self.all), ..self }
    }

    #[inline(always)]
    pub(crate) fn sqrt(self) -> Self {
        Self { all: self.simd.sqrt_f64s(self.all), ..self }
    }

    /// The larger of both; `other` where this is no number.
    #[inline(always)]
    pub(crate) fn max(self, other: Self) -> Self {
        other.less_than(self).select(self, other)
    }

    /// The smaller of both; `other` where this is no number.
    #[inline(always)]
    pub(crate) fn min(self, other: Self) -> Self {
        self.less_than(other).select(self, other)
    }

    /// As [`f64::clamp`] does, of which `low` must not be above `high`.
    #[inline(always)]
    pub(crate) fn clamp(self, low: Self, high: Self) -> Self {
        let raised = self.less_than(low).select(low, self);
        high.less_than(raised).select(high, raised)
    }

    /// This magnitude with the sign of `sign`.
    #[inline(always)]
    pub(crate) fn copysign(self, sign: Self) -> Self {
        let simd = self.simd;
        let bit = simd.splat_f64s(-0.0);
        let magnitude = simd.and_f64s(simd.not_f64s(bit), self.all);
        Self { simd, all: simd.or_f64s(magnitude, simd.and_f64s(bit, sign.all)) }
    }

    #[inline(always)]
    pub(crate) fn less_than(self, other: Self) -> Mask<S> {
        Mask { simd: self.simd, all: self.simd.less_than_f64s(self.all, other.all) }
    }

    #[inline(always)]
    pub(crate) fn at_most(self, other: Self) -> Mask<S> {
        Mask { simd: self.simd, all: self.simd.less_than_or_equal_f64s(self.all, other.all) }
    }

    #[inline(always)]
    pub(crate) fn equals(self, other: Self) -> Mask<S> {
        Mask { simd: self.simd, all: self.simd.equal_f64s(self.all, other.all) }
    }
}

impl<S: Simd> Mask<S> {
    /// The truth value `of` each lane.
    #[inline(always)]
    pub(crate) fn from_fn(simd: S, of: impl Fn(usize) -> bool) -> Self {
        let ones = Lanes::from_fn(simd, |lane| if of(lane) { 1.0 } else { 0.0 });
        Lanes::splat(simd, 0.5).less_than(ones)
    }

    /// `yes` in the lanes in which this is true, `no` in the others.
    #[inline(always)]
    pub(crate) fn select(self, yes: Lanes<S>, no: Lanes<S>) -> Lanes<S> {
        let all = self.simd.select_f64s(self.all, yes.all, no.all);
        Lanes { simd: self.simd, all }
    }

    #[inline(always)]
    pub(crate) fn or(self, other: Self) -> Self {
        Self { all: self.simd.or_m64s(self.all, other.all), ..self }
    }

    #[inline(always)]
    pub(crate) fn not(self) -> Self {
        Self { all: self.simd.not_m64s(self.all), ..self }
    }

    /// Return whether it is true in any lane.
    #[inline(always)]
    pub(crate) fn any(self) -> bool {
        self.simd.first_true_m64s(self.all) < S::F64_LANES
    }

    /// Return whether it is true in all lanes.
    #[inline(always)]
    pub(crate) fn all(self) -> bool {
        !self.not().any()
    }
}

impl<S: Simd> BitAnd for Mask<S> {
    type Output = Self;

    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        Self { all: self.simd.and_m64s(self.all, other.all), ..self }
    }
}

impl<S: Simd> Neg for Lanes<S> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self { all: self.simd.neg_f64s(self.all), ..self }
    }
}

/// One arithmetic operator of lanes with lanes, and of numbers with lanes on either side.
macro_rules! operator {
    ($operator:ident, $name:ident, $call:ident) => {
        impl<S: Simd> $operator for Lanes<S> {
            type Output = Self;

            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                Self { all: self.simd.$call(self.all, other.all), ..self }
            }
        }

        impl<S: Simd> $operator<Lanes<S>> for f64 {
            type Output = Lanes<S>;

            #[inline(always)]
            fn $name(self, other: Lanes<S>) -> Lanes<S> {
                let own = other.simd.splat_f64s(self);
                Lanes { all: other.simd.$call(own, other.all), ..other }
            }
        }
    };
}

operator!(Add, add, add_f64s);
operator!(Sub, sub, sub_f64s);
operator!(Mul, mul, mul_f64s);
operator!(Div, div, div_f64s);

/// Belt coordinates of a vector in board coordinates; see [`crate::gantry::belts`].
#[inline(always)]
pub(crate) fn belts<S: Simd>([x, y]: [Lanes<S>; 2]) -> [Lanes<S>; 2] {
    [x + y, x - y]
}

/// Board coordinates of a vector in belt coordinates; see [`crate::gantry::rails`].
#[inline(always)]
pub(crate) fn rails<S: Simd>([a, b]: [Lanes<S>; 2]) -> [Lanes<S>; 2] {
    [0.5 * (a + b), 0.5 * (a - b)]
}

/// Both of `yes` where `mask` is true, both of `no` elsewhere.
#[inline(always)]
pub(crate) fn select<S: Simd>(
    mask: Mask<S>,
    yes: [Lanes<S>; 2],
    no: [Lanes<S>; 2],
) -> [Lanes<S>; 2] {
    [mask.select(yes[0], no[0]), mask.select(yes[1], no[1])]
}
