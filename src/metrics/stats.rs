//! Order statistics, means with errors, and the two tests that estimators are held to.

/// The median; `None` of nothing.
pub fn median(values: &[f64]) -> Option<f64> {
    percentile(values, 50.0)
}

/// The percentile `p` in 0..100, linear between neighbours in order; `None` of nothing.
pub fn percentile(values: &[f64], p: f64) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let last = sorted.len().checked_sub(1)?;
    let place = (p / 100.0).clamp(0.0, 1.0) * last as f64;
    let (below, above) = (place.floor() as usize, place.ceil() as usize);
    Some(sorted[below] + (sorted[above] - sorted[below]) * (place - place.floor()))
}

/// A mean and how well it is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mean {
    /// The mean.
    pub value: f64,
    /// Its standard error; infinite for one value.
    pub standard_error: f64,
}

/// The mean of independent values; `None` of nothing.
pub fn mean(values: &[f64]) -> Option<Mean> {
    if values.is_empty() {
        return None;
    }
    let count = values.len() as f64;
    let value = values.iter().sum::<f64>() / count;
    let squares: f64 = values.iter().map(|v| (v - value).powi(2)).sum();
    let standard_error =
        if values.len() > 1 { (squares / (count - 1.0) / count).sqrt() } else { f64::INFINITY };
    Some(Mean { value, standard_error })
}

/// The two-sided p-value of a difference, in standard errors, that is normally distributed around 0: the chance
/// of one at least as large.
///
/// A test at significance level α fails where this is below α. NaN counts as impossible: 0.
pub fn z_test(difference: f64, standard_error: f64) -> f64 {
    if difference == 0.0 {
        return 1.0;
    }
    let z = (difference / standard_error).abs();
    if z.is_nan() { 0.0 } else { upper_gamma(0.5, z * z / 2.0) }
}

/// The outcome of Pearson's goodness-of-fit test.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChiSquare {
    /// The sum of (observed - expected)² / expected over cells.
    pub statistic: f64,
    /// Cells, after pooling, less one.
    pub degrees: usize,
    /// The chance of a statistic at least as large where the expectation is true.
    pub p_value: f64,
}

/// Cells that are expected to hold fewer are pooled with those after them (Cochran's rule).
const LEAST_EXPECTED: f64 = 5.0;

/// Pearson's test of counts against expected counts (scaled to the same total).
///
/// `None` where there is nothing to test: lengths differ, fewer than two cells are left after
/// pooling, or an expectation is negative or not finite. A count where none can be has p-value 0.
pub fn chi_square(observed: &[u64], expected: &[f64]) -> Option<ChiSquare> {
    let valid = observed.len() == expected.len() && expected.iter().all(|e| e.is_finite() && *e >= 0.0);
    let counted: f64 = observed.iter().map(|&o| o as f64).sum();
    let total: f64 = expected.iter().sum();
    if !valid || total <= 0.0 {
        return None;
    }
    let impossible = observed.iter().zip(expected).any(|(&o, &e)| o > 0 && e == 0.0);
    let cells = pooled(observed, expected, counted / total);
    let degrees = cells.len().checked_sub(1).filter(|&degrees| degrees > 0)?;
    let statistic = cells.iter().map(|(o, e)| (o - e).powi(2) / e).sum();
    let p_value = if impossible { 0.0 } else { upper_gamma(degrees as f64 / 2.0, statistic / 2.0) };
    Some(ChiSquare { statistic, degrees, p_value })
}

/// Neighbouring cells joined until each expects [`LEAST_EXPECTED`]; what is left over joins the last.
fn pooled(observed: &[u64], expected: &[f64], scale: f64) -> Vec<(f64, f64)> {
    let mut cells: Vec<(f64, f64)> = Vec::new();
    let mut open = (0.0, 0.0);
    for (&o, &e) in observed.iter().zip(expected) {
        open = (open.0 + o as f64, open.1 + e * scale);
        if open.1 >= LEAST_EXPECTED {
            cells.push(std::mem::take(&mut open));
        }
    }
    if let Some(last) = cells.last_mut() {
        *last = (last.0 + open.0, last.1 + open.1);
    }
    cells
}

/// The significance level of each of `tests` tests, so that all of them together raise a false alarm with
/// probability at most `level` (Šidák).
pub fn level_of_each(level: f64, tests: usize) -> f64 {
    -((-level).ln_1p() / tests.max(1) as f64).exp_m1()
}

/// The regularised upper incomplete gamma function Q(a, x), a > 0: its series below a + 1, its continued fraction
/// (by Lentz's method) above (Press et al., Numerical Recipes, 6.2).
pub fn upper_gamma(a: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 1.0;
    }
    if x == f64::INFINITY {
        return 0.0;
    }
    let front = (a * x.ln() - x - ln_gamma(a)).exp();
    if x < a + 1.0 {
        let (mut term, mut sum, mut n) = (1.0 / a, 1.0 / a, a);
        while term > sum * f64::EPSILON {
            n += 1.0;
            term *= x / n;
            sum += term;
        }
        return (1.0 - front * sum).max(0.0);
    }
    let mut b = x + 1.0 - a;
    let (mut c, mut d) = (1.0 / f64::MIN_POSITIVE, 1.0 / b);
    let mut fraction = d;
    for i in 1..100_000 {
        let i = f64::from(i);
        let numerator = -i * (i - a);
        b += 2.0;
        d = 1.0 / nonzero(numerator * d + b);
        c = nonzero(b + numerator / c);
        fraction *= d * c;
        if (d * c - 1.0).abs() <= 2.0 * f64::EPSILON {
            break;
        }
    }
    front * fraction
}

fn nonzero(value: f64) -> f64 {
    if value.abs() < f64::MIN_POSITIVE { f64::MIN_POSITIVE } else { value }
}

/// The logarithm of Γ(x) for x > 0: Stirling's series after x is raised to at least 10.
fn ln_gamma(x: f64) -> f64 {
    let (mut x, mut below) = (x, 0.0);
    while x < 10.0 {
        below += x.ln();
        x += 1.0;
    }
    let (inverse, square) = (1.0 / x, 1.0 / (x * x));
    let series = inverse
        * (1.0 / 12.0
            - square * (1.0 / 360.0 - square * (1.0 / 1260.0 - square * (1.0 / 1680.0 - square / 1188.0))));
    (x - 0.5) * x.ln() - x + 0.5 * std::f64::consts::TAU.ln() + series - below
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(found: f64, expected: f64, relative: f64) {
        assert!((found - expected).abs() <= relative * expected.abs(), "{found} is not {expected}");
    }

    #[test]
    fn order_statistics() {
        let values = [5.0, 1.0, 3.0, 2.0];
        assert_eq!(median(&values), Some(2.5));
        assert_eq!(percentile(&values, 0.0), Some(1.0));
        assert_eq!(percentile(&values, 100.0), Some(5.0));
        close(percentile(&values, 99.0).unwrap(), 4.94, 1e-12);
        assert_eq!(percentile(&[7.0], 99.0), Some(7.0));
        assert_eq!((median(&[]), mean(&[])), (None, None));
    }

    #[test]
    fn mean_knows_its_error() {
        let found = mean(&[1.0, 2.0, 3.0, 4.0]).unwrap();
        assert_eq!(found.value, 2.5);
        close(found.standard_error, (5.0f64 / 3.0 / 4.0).sqrt(), 1e-12);
        assert_eq!(mean(&[3.0]).unwrap().standard_error, f64::INFINITY);
    }

    #[test]
    fn gamma_has_its_known_values() {
        close(ln_gamma(0.5), std::f64::consts::PI.sqrt().ln(), 1e-13);
        close(ln_gamma(11.0), 3_628_800f64.ln(), 1e-14);
        for x in [0.1, 1.0, 5.0, 30.0] {
            close(upper_gamma(1.0, x), (-x).exp(), 1e-12);
            close(upper_gamma(3.0, x), (-x).exp() * (1.0 + x + x * x / 2.0), 1e-12);
        }
        assert_eq!((upper_gamma(2.0, 0.0), upper_gamma(2.0, f64::INFINITY)), (1.0, 0.0));
        close(upper_gamma(1e4, 1e4), 0.498_67, 1e-4);
    }

    #[test]
    fn z_test_knows_the_normal_distribution() {
        close(z_test(1.0, 1.0), 0.317_310_507_862_914, 1e-12);
        close(z_test(-3.919_927_969_080_108, 2.0), 0.05, 1e-9);
        close(z_test(5.0, 1.0), 5.733_031_437_583_9e-7, 1e-9);
        assert_eq!(z_test(0.0, 0.0), 1.0);
        assert_eq!(z_test(1.0, 0.0), 0.0);
        assert_eq!(z_test(f64::NAN, 1.0), 0.0);
    }

    #[test]
    fn chi_square_accepts_what_fits_and_rejects_what_does_not() {
        // Tabulated: the 5 % point for 10 degrees is 18.307, the 0.1 % point for 1 degree 10.828.
        close(upper_gamma(5.0, 18.307_038 / 2.0), 0.05, 1e-6);
        close(upper_gamma(0.5, 10.827_566 / 2.0), 0.001, 1e-6);
        let dice = chi_square(&[18, 22, 19, 21, 20, 20], &[1.0; 6]).unwrap();
        assert_eq!(dice.degrees, 5);
        close(dice.statistic, 0.5, 1e-12);
        assert!(dice.p_value > 0.99);
        let loaded = chi_square(&[5, 22, 19, 21, 20, 33], &[1.0; 6]).unwrap();
        assert!(loaded.p_value < 0.01);
        assert_eq!(chi_square(&[1, 50, 50], &[0.0, 50.0, 50.0]).unwrap().p_value, 0.0);
    }

    #[test]
    fn sparse_cells_are_pooled_and_nothing_is_not_a_pass() {
        let found = chi_square(&[2, 2, 3, 50, 1], &[2.0, 2.0, 2.0, 50.0, 2.0]).unwrap();
        assert_eq!(found.degrees, 1);
        assert_eq!(chi_square(&[], &[]), None);
        assert_eq!(chi_square(&[10], &[10.0]), None);
        assert_eq!(chi_square(&[1, 1], &[1.0, 1.0]), None);
        assert_eq!(chi_square(&[10, 10], &[10.0]), None);
        assert_eq!(chi_square(&[10, 10], &[10.0, f64::NAN]), None);
    }

    #[test]
    fn levels_are_shared_among_tests() {
        close(1.0 - (1.0 - level_of_each(0.01, 20)).powi(20), 0.01, 1e-9);
        assert_eq!(level_of_each(0.05, 1), 0.05);
    }
}
