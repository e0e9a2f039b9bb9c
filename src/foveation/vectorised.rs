//! Functions whose library's versions do not compile to vector instructions.

/// A positive number's power, to some 2e-7 for each octave of the result: unlike the library's, it compiles to vector
/// instructions. The result must be a normal number.
pub(super) fn power_of(x: f32, power: f32) -> f32 {
    let exponent = power * log2(x);
    let whole = (exponent + 256.5) as i32 - 256;
    let rest = (exponent - whole as f32) * std::f32::consts::LN_2;
    // Taylor's series of e^rest, of which |rest| is below 0.35.
    const TERMS: [f32; 7] = [1.0, 1.0, 0.5, 1.0 / 6.0, 1.0 / 24.0, 1.0 / 120.0, 1.0 / 720.0];
    let series = TERMS.iter().rev().fold(0.0, |sum, term| sum * rest + term);
    series * f32::from_bits(((whole + 127) << 23) as u32)
}

/// The logarithm of a normal positive number to base 2, to some 1e-7.
pub(super) fn log2(x: f32) -> f32 {
    // The mantissa of x between the root of 1/2 and that of 2.
    let bits = x.to_bits() as i32;
    let whole = (bits - std::f32::consts::FRAC_1_SQRT_2.to_bits() as i32) >> 23;
    let mantissa = f32::from_bits((bits - (whole << 23)) as u32);
    // ln m = 2 artanh((m - 1) / (m + 1)), by its series.
    let s = (mantissa - 1.0) / (mantissa + 1.0);
    let squared = s * s;
    let series = 1.0 + squared * (1.0 / 3.0 + squared * (1.0 / 5.0 + squared * (1.0 / 7.0)));
    whole as f32 + 2.0 * std::f32::consts::LOG2_E * s * series
}

/// The arc sine of 0 to 1 to some 2e-7 radians (Abramowitz and Stegun 4.4.46): unlike the library's, it
/// compiles to vector instructions.
pub(super) fn arc_sine(x: f32) -> f32 {
    const TERMS: [f32; 8] = [
        std::f32::consts::FRAC_PI_2,
        -0.214_598_8,
        0.088_978_99,
        -0.050_174_305,
        0.030_891_88,
        -0.017_088_126,
        0.006_670_09,
        -0.001_262_491_1,
    ];
    let series = TERMS.iter().rev().fold(0.0, |sum, term| sum * x + term);
    std::f32::consts::FRAC_PI_2 - (1.0 - x).max(0.0).sqrt() * series
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_are_those_of_the_library() {
        for step in 0..2000 {
            let x = (f64::from(step) * 0.011).exp2() as f32 * 1.0001;
            assert!((f64::from(log2(x)) - f64::from(x).log2()).abs() < 2e-6, "{x}");
            for power in [-2.0f32, -5.0 / 6.0, -1.0 / 3.0, 0.0, 1.0, 3.7] {
                let exact = f64::from(x).powf(f64::from(power));
                assert!((f64::from(power_of(x, power)) / exact - 1.0).abs() < 1e-5, "{x} to the {power}");
            }
        }
        for step in 0..=1000 {
            let x = f64::from(step) / 1000.0;
            assert!((f64::from(arc_sine(x as f32)) - x.asin()).abs() < 1e-6, "{x}");
        }
    }
}
