//! Levenberg-Marquardt on problems of the NIST Statistical Reference Datasets, nonlinear regression
//! (<https://www.itl.nist.gov/div898/strd/nls/nls_main.shtml>). Data, starts, certified values and standard errors are those
//! of NIST; of higher difficulty are all but Misra1a.

use super::{
    levenberg_marquardt::{LeastSquares, Limits, Linearization, minimize},
    normal::Normal,
};

/// Largest relative error of an estimate. NIST certifies eleven digits.
const TOLERANCE: f64 = 1e-6;

/// Largest relative error of a standard error: that of the derivatives, amplified by correlations.
const ERROR_TOLERANCE: f64 = 1e-4;

/// Step of the central differences, relative to the parameter.
const DIFFERENCE: f64 = 1e-6;

/// One problem of NIST.
struct Problem {
    name: &'static str,
    /// Prediction from parameters and predictor.
    model: fn(&[f64], f64) -> f64,
    /// Starts 1 (far from the solution) and 2 (nearer).
    starts: [&'static [f64]; 2],
    /// `true` where start 1 leads to the solution without bounds and other starts. From the others, plain
    /// Levenberg-Marquardt steps to a region where the model is constant.
    from_afar: bool,
    certified: &'static [f64],
    standard_errors: &'static [f64],
    residual_sum_of_squares: f64,
    x: &'static [f64],
    y: &'static [f64],
}

/// A problem with rows in units of the residual's standard deviation and parameters in units of their start.
struct Scaled<'p> {
    problem: &'p Problem,
    scales: Vec<f64>,
    deviation: f64,
}

struct Rows {
    residual: Vec<f64>,
    columns: Vec<Vec<f64>>,
}

impl Linearization for Rows {
    fn residual(&self) -> &[f64] {
        &self.residual
    }

    fn columns(&self) -> &[Vec<f64>] {
        &self.columns
    }

    fn take_nuisances_from(&self, _column: &mut [f64]) {}
}

impl<'p> Scaled<'p> {
    fn new(problem: &'p Problem, start: &[f64]) -> Self {
        let freedom = problem.x.len() - problem.certified.len();
        let deviation = (problem.residual_sum_of_squares / freedom as f64).sqrt();
        Self { problem, scales: start.iter().map(|own| own.abs()).collect(), deviation }
    }

    fn predicted(&self, at: &[f64]) -> Vec<f64> {
        self.problem.x.iter().map(|x| (self.problem.model)(at, *x) / self.deviation).collect()
    }

    fn slope(&self, at: &[f64], index: usize) -> Vec<f64> {
        let change = DIFFERENCE * at[index].abs().max(DIFFERENCE * self.scales[index]);
        let [below, above] = [-change, change].map(|change| {
            let mut moved = at.to_vec();
            moved[index] += change;
            self.predicted(&moved)
        });
        let factor = self.scales[index] / (2.0 * change);
        above.iter().zip(&below).map(|(above, below)| factor * (above - below)).collect()
    }
}

impl LeastSquares for Scaled<'_> {
    type At = Vec<f64>;
    type Linear = Rows;

    fn residual(&self, at: &Vec<f64>) -> Vec<f64> {
        let measured = self.problem.y.iter().map(|y| y / self.deviation);
        measured.zip(self.predicted(at)).map(|(measured, own)| measured - own).collect()
    }

    fn columns(&self, at: &Vec<f64>, first: usize) -> Vec<Vec<f64>> {
        (first..at.len()).map(|index| self.slope(at, index)).collect()
    }

    fn linear(&self, at: &Vec<f64>, columns: Vec<Vec<f64>>) -> Rows {
        Rows { residual: self.residual(at), columns }
    }

    fn is_blocked(&self, _at: &Vec<f64>, _index: usize, _slope: f64) -> bool {
        false
    }

    fn moved(&self, at: &Vec<f64>, step: &[f64], _linear: &Rows) -> (Vec<f64>, Vec<f64>) {
        let moved = at.iter().zip(step).zip(&self.scales);
        (moved.map(|((at, step), scale)| at + scale * step).collect(), step.to_vec())
    }
}

/// Fit from `start`, and its squared error over the certified one.
fn fitted(problem: &Problem, start: &[f64]) -> (Vec<f64>, f64) {
    let limits = Limits { iterations: 2000, secant_steps: 2, converged: 1e-13 };
    let scaled = Scaled::new(problem, start);
    let found = minimize(&scaled, start.to_vec(), &[], &limits);
    let sum = found.loss * scaled.deviation.powi(2);
    (found.at, sum / problem.residual_sum_of_squares)
}

fn is_certified(problem: &Problem, (found, excess): &(Vec<f64>, f64)) -> bool {
    let near = |(value, truth): (&f64, &f64)| (value / truth - 1.0).abs() < TOLERANCE;
    (excess - 1.0).abs() < TOLERANCE && found.iter().zip(problem.certified).all(near)
}

#[test]
fn starts_lead_to_the_certified_values() {
    for problem in PROBLEMS {
        let [far, near] = problem.starts.map(|start| fitted(problem, start));
        assert!(is_certified(problem, &near), "{}, start 2: {near:?}", problem.name);
        assert_eq!(is_certified(problem, &far), problem.from_afar, "{}: {far:?}", problem.name);
    }
}

/// The search tries several starts and takes the smallest squared error. So a start with another minimum must have a
/// larger one.
#[test]
fn a_start_that_leads_elsewhere_has_a_larger_squared_error() {
    for problem in PROBLEMS.iter().filter(|own| !own.from_afar) {
        let [far, near] = problem.starts.map(|start| fitted(problem, start).1);
        assert!(1.1 * near < far, "{}: {far} {near}", problem.name);
    }
}

#[test]
fn the_normal_matrix_at_the_certified_values_has_the_certified_standard_errors() {
    for problem in PROBLEMS {
        let scaled = Scaled::new(problem, problem.certified);
        let at = problem.certified.to_vec();
        let inverse = Normal::new(&scaled.columns(&at, 0), &scaled.residual(&at)).inverse();
        for (index, expected) in problem.standard_errors.iter().enumerate() {
            let error = inverse[(index, index)].sqrt() * scaled.scales[index];
            let Problem { name, .. } = problem;
            assert!(
                (error / expected - 1.0).abs() < ERROR_TOLERANCE,
                "{name} {index}: {error} {expected}"
            );
        }
    }
}

const PROBLEMS: &[Problem] = &[
    Problem {
        name: "Misra1a",
        model: |b, x| b[0] * (1.0 - (-b[1] * x).exp()),
        starts: [&[500.0, 0.0001], &[250.0, 0.0005]],
        from_afar: true,
        certified: &[238.942_129_18, 0.000_550_156_431_81],
        standard_errors: &[2.707_007_524_1, 7.2668688436e-6],
        residual_sum_of_squares: 0.124_551_388_94,
        x: &[
            77.6, 114.9, 141.1, 190.8, 239.9, 289.0, 332.8, 378.4, 434.8, 477.3, 536.8, 593.1,
            689.1, 760.0,
        ],
        y: &[
            10.07, 14.73, 17.94, 23.93, 29.61, 35.18, 40.02, 44.82, 50.76, 55.05, 61.01, 66.4,
            75.47, 81.78,
        ],
    },
    Problem {
        name: "BoxBOD",
        model: |b, x| b[0] * (1.0 - (-b[1] * x).exp()),
        starts: [&[1.0, 1.0], &[100.0, 0.75]],
        from_afar: false,
        certified: &[213.809_408_89, 0.547_237_485_42],
        standard_errors: &[12.354_515_176, 0.104_559_932_37],
        residual_sum_of_squares: 1_168.008_876_6,
        x: &[1.0, 2.0, 3.0, 5.0, 7.0, 10.0],
        y: &[109.0, 149.0, 149.0, 191.0, 213.0, 224.0],
    },
    Problem {
        name: "Rat43",
        model: |b, x| b[0] / (1.0 + (b[1] - b[2] * x).exp()).powf(1.0 / b[3]),
        starts: [&[100.0, 10.0, 1.0, 1.0], &[700.0, 5.0, 0.75, 1.3]],
        from_afar: true,
        certified: &[699.641_512_7, 5.277_125_302_5, 0.759_629_383_29, 1.279_248_385_9],
        standard_errors: &[16.302_297_817, 2.082_873_582_9, 0.195_661_234_51, 0.687_619_363_85],
        residual_sum_of_squares: 8_786.404_908,
        x: &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0],
        y: &[
            16.08, 33.83, 65.8, 97.2, 191.55, 326.2, 386.87, 520.53, 590.03, 651.92, 724.93,
            699.56, 689.96, 637.56, 717.41,
        ],
    },
    Problem {
        name: "Eckerle4",
        model: |b, x| b[0] / b[1] * (-0.5 * ((x - b[2]) / b[1]).powi(2)).exp(),
        starts: [&[1.0, 10.0, 500.0], &[1.5, 5.0, 450.0]],
        from_afar: false,
        certified: &[1.554_382_717_8, 4.088_832_175_4, 451.541_218_44],
        standard_errors: &[0.015_408_051_163, 0.046_803_020_753, 0.046_800_518_816],
        residual_sum_of_squares: 0.001_463_588_748_7,
        x: &[
            400.0, 405.0, 410.0, 415.0, 420.0, 425.0, 430.0, 435.0, 436.5, 438.0, 439.5, 441.0,
            442.5, 444.0, 445.5, 447.0, 448.5, 450.0, 451.5, 453.0, 454.5, 456.0, 457.5, 459.0,
            460.5, 462.0, 463.5, 465.0, 470.0, 475.0, 480.0, 485.0, 490.0, 495.0, 500.0,
        ],
        y: &[
            0.000_157_5,
            0.000_169_9,
            0.000_235,
            0.000_310_2,
            0.000_491_7,
            0.000_871,
            0.001_741_8,
            0.004_64,
            0.006_589_5,
            0.009_730_2,
            0.014_900_2,
            0.023_731,
            0.040_168_3,
            0.071_255_9,
            0.126_445_8,
            0.207_341_3,
            0.290_236_6,
            0.344_562_3,
            0.369_804_9,
            0.366_853_4,
            0.310_672_7,
            0.207_815_4,
            0.116_435_4,
            0.061_676_4,
            0.033_72,
            0.019_402_3,
            0.011_783_1,
            0.007_435_7,
            0.002_273_2,
            0.000_88,
            0.000_457_9,
            0.000_234_5,
            0.000_158_6,
            0.000_114_3,
            7.1e-5,
        ],
    },
    Problem {
        name: "MGH09",
        model: |b, x| b[0] * (x * x + x * b[1]) / (x * x + x * b[2] + b[3]),
        starts: [&[25.0, 39.0, 41.5, 39.0], &[0.25, 0.39, 0.415, 0.39]],
        from_afar: false,
        certified: &[0.192_806_934_58, 0.191_282_328_73, 0.123_056_506_93, 0.136_062_330_68],
        standard_errors: &[
            0.011_435_312_227,
            0.196_332_209_11,
            0.080_842_031_232,
            0.090_025_542_308,
        ],
        residual_sum_of_squares: 0.000_307_505_603_85,
        x: &[4.0, 2.0, 1.0, 0.5, 0.25, 0.167, 0.125, 0.1, 0.0833, 0.0714, 0.0625],
        y: &[0.1957, 0.1947, 0.1735, 0.16, 0.0844, 0.0627, 0.0456, 0.0342, 0.0323, 0.0235, 0.0246],
    },
    Problem {
        name: "MGH10",
        model: |b, x| b[0] * (b[1] / (x + b[2])).exp(),
        starts: [&[2.0, 400_000.0, 25_000.0], &[0.02, 4000.0, 250.0]],
        from_afar: false,
        certified: &[0.005_609_636_471, 6_181.346_346_3, 345.223_634_62],
        standard_errors: &[0.000_156_878_924_71, 23.309_021_107, 0.784_861_035_08],
        residual_sum_of_squares: 87.945_855_171,
        x: &[
            50.0, 55.0, 60.0, 65.0, 70.0, 75.0, 80.0, 85.0, 90.0, 95.0, 100.0, 105.0, 110.0, 115.0,
            120.0, 125.0,
        ],
        y: &[
            34_780.0, 28_610.0, 23_650.0, 19_630.0, 16_370.0, 13_720.0, 11_540.0, 9744.0, 8261.0,
            7030.0, 6005.0, 5147.0, 4427.0, 3820.0, 3307.0, 2872.0,
        ],
    },
    Problem {
        name: "Thurber",
        model: |b, x| {
            let above = b[0] + x * (b[1] + x * (b[2] + x * b[3]));
            above / (1.0 + x * (b[4] + x * (b[5] + x * b[6])))
        },
        starts: [
            &[1000.0, 1000.0, 400.0, 40.0, 0.7, 0.3, 0.03],
            &[1300.0, 1500.0, 500.0, 75.0, 1.0, 0.4, 0.05],
        ],
        from_afar: true,
        certified: &[
            1_288.139_68,
            1_491.079_253_5,
            583.238_368_77,
            75.416_644_291,
            0.966_295_028_64,
            0.397_972_857_97,
            0.049_727_297_349,
        ],
        standard_errors: &[
            4.664_796_334_4,
            39.571_156_086,
            28.698_696_102,
            5.567_537_027,
            0.031_333_340_687,
            0.014_984_928_198,
            0.006_584_234_462_3,
        ],
        residual_sum_of_squares: 5_642.708_239_7,
        x: &[
            -3.067, -2.981, -2.921, -2.912, -2.84, -2.797, -2.702, -2.699, -2.633, -2.481, -2.363,
            -2.322, -1.501, -1.46, -1.274, -1.212, -1.1, -1.046, -0.915, -0.714, -0.566, -0.545,
            -0.4, -0.309, -0.109, -0.103, 0.01, 0.119, 0.377, 0.79, 0.963, 1.006, 1.115, 1.572,
            1.841, 2.047, 2.2,
        ],
        y: &[
            80.574, 84.248, 87.264, 87.195, 89.076, 89.608, 89.868, 90.101, 92.405, 95.854,
            100.696, 101.06, 401.672, 390.724, 567.534, 635.316, 733.054, 759.087, 894.206,
            990.785, 1090.109, 1080.914, 1122.643, 1178.351, 1260.531, 1273.514, 1288.339,
            1327.543, 1353.863, 1414.509, 1425.208, 1421.384, 1442.962, 1464.35, 1468.705,
            1447.894, 1457.628,
        ],
    },
];
