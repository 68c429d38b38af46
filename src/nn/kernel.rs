//! Dense-layer kernels for small networks, generic over the vector width.
//!
//! At 64 units a general matrix product spends much of its time on packing and dispatch. Here the
//! weights are stored in the layout of the micro-kernel. Bias, activation and its derivative are
//! applied while results are in the cache, and nothing is allocated. The register tile is that of
//! Goto and van de Geijn, "Anatomy of High-Performance Matrix Multiplication" (2008): `ROWS` x
//! `COLS` accumulators, `COLS` vectors of the right factor, one broadcast of the left.
//!
//! Shapes: `x` is `[batch][x_stride]`, `y` is `[batch][columns]`, weights are `[depth][columns]`,
//! all row-major; `columns` is a multiple of [`PAD`]. Padded columns hold zeros and stay zero.
//! Sums run in a fixed order, so equal inputs give equal bytes on a machine.

use super::network::Activation;
use pulp::Simd;

/// Padding of widths: a multiple of this many `f32`, the widest vector.
pub const PAD: usize = 16;

/// Round a width up to a multiple of [`PAD`].
#[must_use]
pub fn padded(width: usize) -> usize {
    width.div_ceil(PAD) * PAD
}

/// Rows of the register tile: 6 x 4 accumulators, 4 vectors and a broadcast fit 32 registers.
const ROWS: usize = 6;

/// Depth of one pass over the weights: `64 x 64` floats stay in a first-level cache of 32 KiB.
const DEPTH_BLOCK: usize = 64;

/// Repetition of `$body` for the constants `$i` = 0 to 5 below `$end`. It is unrolled by hand, because
/// the compiler keeps an array in registers only when every index is a constant.
macro_rules! unrolled {
    ($i:ident < $end:expr, $body:expr) => {
        unrolled!(@ $i, $end, $body, 0 1 2 3 4 5)
    };
    (@ $i:ident, $end:expr, $body:expr, $($value:literal)*) => {{
        $({
            const $i: usize = $value;
            if $i < $end {
                $body
            }
        })*
    }};
}

/// Operation on the complete results of some columns.
#[derive(Clone, Copy)]
pub(super) enum Epilogue<'a> {
    /// No operation.
    Linear,
    /// Activation function.
    Activate(Activation),
    /// Multiplication with the activation's derivative, computed from the activation's own value
    /// (same shape as the result): 1 or 0 for ReLU, `(1 - |a|)^2` for softsign, 1 or `1 + a` for
    /// ELU, `1 - a^2` for tanh.
    Derivative(Activation, &'a [f32]),
}

/// One matrix product with its start value and epilogue.
#[derive(Clone, Copy)]
pub(super) struct Product<'a> {
    /// Left factor `[batch][x_stride]`, of which the first `depth` of each row are used.
    pub(super) x: &'a [f32],
    pub(super) x_stride: usize,
    pub(super) depth: usize,
    /// Right factor `[depth][columns]`.
    pub(super) weights: &'a [f32],
    /// Start value `[columns]`, added to every row; zeros when absent.
    pub(super) bias: Option<&'a [f32]>,
    pub(super) epilogue: Epilogue<'a>,
}

/// Compute `y = epilogue(bias + x w)`, with `y` `[batch][columns]`.
#[inline(always)]
pub(super) fn product<S: Simd>(simd: S, y: &mut [f32], columns: usize, p: Product<'_>) {
    let vectors = columns / S::F32_LANES;
    let mut first_column = 0;
    while first_column < vectors {
        let left = vectors - first_column;
        let taken = if wide_tile::<S>() && 4 <= left {
            product_columns::<S, 4>(simd, y, vectors, first_column, p)
        } else if 2 <= left {
            product_columns::<S, 2>(simd, y, vectors, first_column, p)
        } else {
            product_columns::<S, 1>(simd, y, vectors, first_column, p)
        };
        first_column += taken;
    }
}

/// Return whether four vectors per row fit the register file.
#[inline(always)]
fn wide_tile<S: Simd>() -> bool {
    32 <= S::REGISTER_COUNT
}

#[inline(always)]
fn product_columns<S: Simd, const COLS: usize>(
    simd: S,
    y: &mut [f32],
    vectors: usize,
    first_column: usize,
    p: Product<'_>,
) -> usize {
    let batch = p.x.len() / p.x_stride;
    let mut depth_from = 0;
    loop {
        let depth_to = p.depth.min(depth_from + DEPTH_BLOCK);
        let block = Block { first_column, vectors, depth_from, depth_to };
        let mut row = 0;
        while row + ROWS <= batch {
            product_tile::<S, ROWS, COLS>(simd, y, row, block, p);
            row += ROWS;
        }
        if row + 4 <= batch {
            product_tile::<S, 4, COLS>(simd, y, row, block, p);
            row += 4;
        }
        if row + 2 <= batch {
            product_tile::<S, 2, COLS>(simd, y, row, block, p);
            row += 2;
        }
        if row < batch {
            product_tile::<S, 1, COLS>(simd, y, row, block, p);
        }
        if depth_to == p.depth {
            finish::<S, COLS>(simd, y, (first_column, vectors), p.epilogue);
            return COLS;
        }
        depth_from = depth_to;
    }
}

/// Part of a product covered by one pass.
#[derive(Clone, Copy)]
struct Block {
    first_column: usize,
    vectors: usize,
    depth_from: usize,
    depth_to: usize,
}

#[inline(always)]
fn product_tile<S: Simd, const R: usize, const C: usize>(
    simd: S,
    y: &mut [f32],
    row: usize,
    block: Block,
    p: Product<'_>,
) {
    let Block { first_column, vectors, depth_from, depth_to } = block;
    let depth = depth_to - depth_from;
    let start: Option<&[S::f32s]> = match p.bias {
        Some(bias) if depth_from == 0 => Some(S::as_simd_f32s(bias).0),
        _ => None,
    };
    let (y, _) = S::as_mut_simd_f32s(y);
    let mut acc = [[simd.splat_f32s(0.0); C]; R];
    if let Some(bias) = start {
        let bias = &bias[first_column..first_column + C];
        unrolled!(I < R, unrolled!(J < C, acc[I][J] = bias[J]));
    } else if 0 < depth_from {
        unrolled!(I < R, {
            let y = &y[(row + I) * vectors + first_column..][..C];
            unrolled!(J < C, acc[I][J] = y[J])
        });
    }
    let x: [&[f32]; R] = std::array::from_fn(|r| {
        let at = (row + r) * p.x_stride + depth_from;
        &p.x[at..at + depth]
    });
    let (w, _) = S::as_simd_f32s(p.weights);
    let w = &w[depth_from * vectors..depth_to * vectors];
    for (k, w) in w.chunks_exact(vectors).enumerate().take(depth) {
        let w = &w[first_column..first_column + C];
        unrolled!(I < R, {
            let left = simd.splat_f32s(x[I][k]);
            unrolled!(J < C, acc[I][J] = simd.mul_add_e_f32s(left, w[J], acc[I][J]))
        });
    }
    unrolled!(I < R, {
        let at = (row + I) * vectors + first_column;
        let y = &mut y[at..at + C];
        unrolled!(J < C, y[J] = acc[I][J])
    });
}

/// Apply the epilogue to `C` vectors of every row. Rows are a separate loop: within the register
/// tile, the compiler would spread the exponentials over its accumulators and spill them.
#[inline(always)]
fn finish<S: Simd, const C: usize>(
    simd: S,
    y: &mut [f32],
    (first_column, vectors): (usize, usize),
    epilogue: Epilogue<'_>,
) {
    let (y, _) = S::as_mut_simd_f32s(y);
    let at = (first_column, vectors);
    match epilogue {
        Epilogue::Linear => {}
        Epilogue::Activate(Activation::Relu) => activate::<S, Relu, C>(simd, y, at),
        Epilogue::Activate(Activation::Softsign) => activate::<S, Softsign, C>(simd, y, at),
        Epilogue::Activate(Activation::Elu) => activate::<S, Elu, C>(simd, y, at),
        Epilogue::Activate(Activation::Tanh) => activate::<S, Tanh, C>(simd, y, at),
        Epilogue::Derivative(activation, of) => {
            let (of, _) = S::as_simd_f32s(of);
            match activation {
                Activation::Relu => slope::<S, Relu, C>(simd, y, of, at),
                Activation::Softsign => slope::<S, Softsign, C>(simd, y, of, at),
                Activation::Elu => slope::<S, Elu, C>(simd, y, of, at),
                Activation::Tanh => slope::<S, Tanh, C>(simd, y, of, at),
            }
        }
    }
}

/// Replace values by their activations.
#[inline(always)]
fn activate<S: Simd, A: Curve, const C: usize>(
    simd: S,
    y: &mut [S::f32s],
    (first_column, vectors): (usize, usize),
) {
    for row in y.chunks_exact_mut(vectors) {
        for value in &mut row[first_column..first_column + C] {
            *value = A::value(simd, *value);
        }
    }
}

/// Multiply values by the activation's derivative where its values are `of`.
#[inline(always)]
fn slope<S: Simd, A: Curve, const C: usize>(
    simd: S,
    y: &mut [S::f32s],
    of: &[S::f32s],
    (first_column, vectors): (usize, usize),
) {
    let columns = first_column..first_column + C;
    for (row, of) in y.chunks_exact_mut(vectors).zip(of.chunks_exact(vectors)) {
        for (value, of) in row[columns.clone()].iter_mut().zip(&of[columns.clone()]) {
            *value = simd.mul_f32s(*value, A::derivative(simd, *of));
        }
    }
}

/// Activation as a type, so that it is selected outside of the loops.
pub(super) trait Curve {
    /// Return the activation at `z`.
    fn value<S: Simd>(simd: S, z: S::f32s) -> S::f32s;

    /// Return the derivative at a point where the value is `a`.
    fn derivative<S: Simd>(simd: S, a: S::f32s) -> S::f32s;
}

pub(super) struct Relu;
pub(super) struct Softsign;
pub(super) struct Elu;
pub(super) struct Tanh;

impl Curve for Relu {
    #[inline(always)]
    fn value<S: Simd>(simd: S, z: S::f32s) -> S::f32s {
        simd.max_f32s(z, simd.splat_f32s(0.0))
    }

    #[inline(always)]
    fn derivative<S: Simd>(simd: S, a: S::f32s) -> S::f32s {
        let (zero, one) = (simd.splat_f32s(0.0), simd.splat_f32s(1.0));
        simd.select_f32s(simd.less_than_f32s(zero, a), one, zero)
    }
}

impl Curve for Softsign {
    #[inline(always)]
    fn value<S: Simd>(simd: S, z: S::f32s) -> S::f32s {
        simd.div_f32s(z, simd.add_f32s(simd.splat_f32s(1.0), simd.abs_f32s(z)))
    }

    #[inline(always)]
    fn derivative<S: Simd>(simd: S, a: S::f32s) -> S::f32s {
        let slope = simd.sub_f32s(simd.splat_f32s(1.0), simd.abs_f32s(a));
        simd.mul_f32s(slope, slope)
    }
}

impl Curve for Elu {
    #[inline(always)]
    fn value<S: Simd>(simd: S, z: S::f32s) -> S::f32s {
        let zero = simd.splat_f32s(0.0);
        let below = exp_m1(simd, simd.min_f32s(zero, z));
        simd.select_f32s(simd.less_than_f32s(zero, z), z, below)
    }

    #[inline(always)]
    fn derivative<S: Simd>(simd: S, a: S::f32s) -> S::f32s {
        let (zero, one) = (simd.splat_f32s(0.0), simd.splat_f32s(1.0));
        simd.add_f32s(one, simd.min_f32s(zero, a))
    }
}

impl Curve for Tanh {
    /// Compute `tanh |z| = -e / (2 + e)` with `e = exp(-2 |z|) - 1`.
    #[inline(always)]
    fn value<S: Simd>(simd: S, z: S::f32s) -> S::f32s {
        let twice = simd.mul_f32s(simd.splat_f32s(-2.0), simd.abs_f32s(z));
        let e = exp_m1(simd, twice);
        let negative = simd.div_f32s(e, simd.add_f32s(simd.splat_f32s(2.0), e));
        let below = simd.less_than_f32s(z, simd.splat_f32s(0.0));
        simd.select_f32s(below, negative, simd.neg_f32s(negative))
    }

    #[inline(always)]
    fn derivative<S: Simd>(simd: S, a: S::f32s) -> S::f32s {
        simd.negate_mul_add_e_f32s(a, a, simd.splat_f32s(1.0))
    }
}

/// Return `exp(x) - 1` for `x` up to 0, within 2e-7 of the true value and accurate near 0.
///
/// `x = n ln 2 + r`, and `exp(x) - 1 = 2^n (exp(r) - 1) + (2^n - 1)`. The polynomial for `exp(r)` on
/// `|r| < ln 2 / 2` and the split of `ln 2` are those of Cephes (Moshier, 1989), `expf.c`.
#[inline(always)]
fn exp_m1<S: Simd>(simd: S, x: S::f32s) -> S::f32s {
    /// Rounding constant, 1.5 times 2^23: added to a small number, it leaves the nearest integer in
    /// the low bits.
    const ROUND: f32 = 12_582_912.0;
    const LN_2: [f32; 2] = [0.693_359_4, -2.121_944_4e-4];
    const POLYNOMIAL: [f32; 6] =
        [1.987_569_1e-4, 1.398_2e-3, 8.333_452e-3, 4.166_579_6e-2, 1.666_666_5e-1, 0.5];
    /// Lower bound: below it, the result is -1 in single precision, and 2^n would be denormal.
    const LOWEST: f32 = -87.0;
    let x = simd.max_f32s(simd.splat_f32s(LOWEST), x);
    let shifted =
        simd.mul_add_e_f32s(x, simd.splat_f32s(std::f32::consts::LOG2_E), simd.splat_f32s(ROUND));
    let n = simd.sub_f32s(shifted, simd.splat_f32s(ROUND));
    let r = simd.mul_add_e_f32s(n, simd.splat_f32s(-LN_2[0]), x);
    let r = simd.mul_add_e_f32s(n, simd.splat_f32s(-LN_2[1]), r);
    let mut p = simd.splat_f32s(POLYNOMIAL[0]);
    for coefficient in &POLYNOMIAL[1..] {
        p = simd.mul_add_e_f32s(p, r, simd.splat_f32s(*coefficient));
    }
    let p = simd.mul_add_e_f32s(p, simd.mul_f32s(r, r), r);
    // The exponent's bias, and the mantissa's width.
    let biased = simd.add_u32s(simd.transmute_u32s_f32s(shifted), simd.splat_u32s(127));
    let power = simd.wrapping_dyn_shl_u32s(biased, simd.splat_u32s(23));
    let power = simd.transmute_f32s_u32s(power);
    simd.mul_add_e_f32s(power, p, simd.sub_f32s(power, simd.splat_f32s(1.0)))
}

/// Accumulate `dw += x^T dy` and `db += sum over the batch of dy`; `x` `[batch][x_stride]`, `dy`
/// `[batch][columns]`, `dw` `[depth][columns]`, `db` `[columns]`.
#[inline(always)]
pub(super) fn gradient<S: Simd>(
    simd: S,
    (dw, db): (&mut [f32], &mut [f32]),
    columns: usize,
    (x, x_stride): (&[f32], usize),
    dy: &[f32],
) {
    let vectors = columns / S::F32_LANES;
    let (dy, _) = S::as_simd_f32s(dy);
    let (db, _) = S::as_mut_simd_f32s(db);
    for row in dy.chunks_exact(vectors) {
        for (sum, value) in db.iter_mut().zip(row) {
            *sum = simd.add_f32s(*sum, *value);
        }
    }
    let (dw, _) = S::as_mut_simd_f32s(dw);
    let samples = DEPTH_BLOCK;
    for (x, dy) in x.chunks(samples * x_stride).zip(dy.chunks(samples * vectors)) {
        let mut first_column = 0;
        while first_column < vectors {
            let left = vectors - first_column;
            first_column += if wide_tile::<S>() && 4 <= left {
                gradient_columns::<S, 4>(simd, dw, [vectors, first_column], (x, x_stride), dy)
            } else if 2 <= left {
                gradient_columns::<S, 2>(simd, dw, [vectors, first_column], (x, x_stride), dy)
            } else {
                gradient_columns::<S, 1>(simd, dw, [vectors, first_column], (x, x_stride), dy)
            };
        }
    }
}

#[inline(always)]
fn gradient_columns<S: Simd, const COLS: usize>(
    simd: S,
    dw: &mut [S::f32s],
    at: [usize; 2],
    x: (&[f32], usize),
    dy: &[S::f32s],
) -> usize {
    let depth = dw.len() / at[0];
    let mut row = 0;
    while row + ROWS <= depth {
        gradient_tile::<S, ROWS, COLS>(simd, dw, (at, row), x, dy);
        row += ROWS;
    }
    if row + 4 <= depth {
        gradient_tile::<S, 4, COLS>(simd, dw, (at, row), x, dy);
        row += 4;
    }
    if row + 2 <= depth {
        gradient_tile::<S, 2, COLS>(simd, dw, (at, row), x, dy);
        row += 2;
    }
    if row < depth {
        gradient_tile::<S, 1, COLS>(simd, dw, (at, row), x, dy);
    }
    COLS
}

#[inline(always)]
fn gradient_tile<S: Simd, const R: usize, const C: usize>(
    simd: S,
    dw: &mut [S::f32s],
    ([vectors, first_column], row): ([usize; 2], usize),
    (x, x_stride): (&[f32], usize),
    dy: &[S::f32s],
) {
    let mut acc = [[simd.splat_f32s(0.0); C]; R];
    unrolled!(I < R, {
        let dw = &dw[(row + I) * vectors + first_column..][..C];
        unrolled!(J < C, acc[I][J] = dw[J])
    });
    for (x, dy) in x.chunks_exact(x_stride).zip(dy.chunks_exact(vectors)) {
        let x = &x[row..row + R];
        let dy = &dy[first_column..first_column + C];
        unrolled!(I < R, {
            let left = simd.splat_f32s(x[I]);
            unrolled!(J < C, acc[I][J] = simd.mul_add_e_f32s(left, dy[J], acc[I][J]))
        });
    }
    unrolled!(I < R, {
        let dw = &mut dw[(row + I) * vectors + first_column..][..C];
        unrolled!(J < C, dw[J] = acc[I][J])
    });
}

/// Compute the narrow last layer, `y = bias + w x` with `OUT` outputs. Weights are
/// `[OUT][columns]`, so that each output is one long dot product; a wide product would waste most
/// of its vector.
#[inline(always)]
pub(super) fn narrow<S: Simd, const OUT: usize>(
    simd: S,
    y: &mut [f32],
    (weights, bias): (&[f32], &[f32]),
    (x, columns): (&[f32], usize),
) {
    let vectors = columns / S::F32_LANES;
    let (w, _) = S::as_simd_f32s(weights);
    let (x, _) = S::as_simd_f32s(x);
    let w: [&[S::f32s]; OUT] = std::array::from_fn(|o| &w[o * vectors..(o + 1) * vectors]);
    for (y, x) in y.chunks_exact_mut(OUT).zip(x.chunks_exact(vectors)) {
        let mut acc = [simd.splat_f32s(0.0); OUT];
        for (k, value) in x.iter().enumerate() {
            for o in 0..OUT {
                acc[o] = simd.mul_add_e_f32s(w[o][k], *value, acc[o]);
            }
        }
        for o in 0..OUT {
            y[o] = bias[o] + simd.reduce_sum_f32s(acc[o]);
        }
    }
}

/// Backward pass of [`narrow`] in one sweep: `dw += dy^T x`, `db += sum dy`, and `dx = (dy w) *
/// activation'(x)`.
#[inline(always)]
pub(super) fn narrow_backward<S: Simd, A: Curve, const OUT: usize>(
    simd: S,
    (dw, db): (&mut [f32], &mut [f32]),
    dx: &mut [f32],
    (weights, dy): (&[f32], &[f32]),
    (x, columns): (&[f32], usize),
) {
    let vectors = columns / S::F32_LANES;
    let (w, _) = S::as_simd_f32s(weights);
    let (x, _) = S::as_simd_f32s(x);
    let (dx, _) = S::as_mut_simd_f32s(dx);
    let (dw, _) = S::as_mut_simd_f32s(dw);
    for dy in dy.chunks_exact(OUT) {
        for o in 0..OUT {
            db[o] += dy[o];
        }
    }
    for k in 0..vectors {
        let w: [S::f32s; OUT] = std::array::from_fn(|o| w[o * vectors + k]);
        let mut sums: [S::f32s; OUT] = std::array::from_fn(|o| dw[o * vectors + k]);
        let rows = x.chunks_exact(vectors).zip(dx.chunks_exact_mut(vectors));
        for ((x, dx), dy) in rows.zip(dy.chunks_exact(OUT)) {
            let mut back = simd.splat_f32s(0.0);
            for o in 0..OUT {
                let d = simd.splat_f32s(dy[o]);
                back = simd.mul_add_e_f32s(d, w[o], back);
                sums[o] = simd.mul_add_e_f32s(d, x[k], sums[o]);
            }
            dx[k] = simd.mul_f32s(back, A::derivative(simd, x[k]));
        }
        for o in 0..OUT {
            dw[o * vectors + k] = sums[o];
        }
    }
}
