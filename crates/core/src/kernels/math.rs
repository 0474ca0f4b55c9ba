//! Branch-free exp, ln and sin/cos that the compiler can vectorise; relative errors below 4e-16 to 1e-15.

const ROUND: f64 = 6_755_399_441_055_744.0; // 1.5 · 2^52: adding it rounds to an integer held in the low bits

/// Floor as an integer, and the fraction, through the rounding trick (vectorises, where `floor` is a call on the
/// baseline); `value` must be within ±2^31.
#[inline(always)]
#[must_use]
pub fn floor_split(value: f64) -> (i32, f64) {
    let nearest = (value + ROUND) - ROUND;
    let floor = if nearest > value { nearest - 1.0 } else { nearest };
    ((floor + ROUND).to_bits() as i32, value - floor)
}

/// e^x for x in [−708, 708]; below, the value at −708 (3e-308).
#[inline(always)]
#[must_use]
pub fn exp(x: f64) -> f64 {
    const LOG2_E: f64 = std::f64::consts::LOG2_E;
    const LN2_HI: f64 = 6.931_471_803_691_238e-1;
    const LN2_LO: f64 = 1.908_214_929_270_587_7e-10;
    let x = if x < -708.0 { -708.0 } else { x };
    let x = if x > 708.0 { 708.0 } else { x };
    let t = x * LOG2_E + ROUND;
    let n = t - ROUND;
    let r = (x - n * LN2_HI) - n * LN2_LO;
    let mut p = 1.0 / 6_227_020_800.0;
    for c in [
        1.0 / 479_001_600.0,
        1.0 / 39_916_800.0,
        1.0 / 3_628_800.0,
        1.0 / 362_880.0,
        1.0 / 40_320.0,
        1.0 / 5_040.0,
        1.0 / 720.0,
        1.0 / 120.0,
        1.0 / 24.0,
        1.0 / 6.0,
        0.5,
        1.0,
        1.0,
    ] {
        p = p * r + c;
    }
    p * f64::from_bits(t.to_bits().wrapping_add(1023) << 52)
}

/// ln x for positive normal x.
#[inline(always)]
#[must_use]
pub fn ln(x: f64) -> f64 {
    const LN2_HI: f64 = 6.931_471_803_691_238e-1;
    const LN2_LO: f64 = 1.908_214_929_270_587_7e-10;
    const TWO_52: f64 = 4_503_599_627_370_496.0;
    let bits = x.to_bits();
    let exponent = f64::from_bits((bits >> 52) | 0x4330_0000_0000_0000) - TWO_52 - 1023.0;
    let mantissa = f64::from_bits((bits & 0x000f_ffff_ffff_ffff) | 0x3ff0_0000_0000_0000);
    let high = mantissa > std::f64::consts::SQRT_2;
    let m = if high { 0.5 * mantissa } else { mantissa };
    let e = if high { exponent + 1.0 } else { exponent };
    let f = m - 1.0;
    let s = f / (2.0 + f);
    let z = s * s;
    let mut p = 1.0 / 21.0;
    for c in [
        1.0 / 19.0,
        1.0 / 17.0,
        1.0 / 15.0,
        1.0 / 13.0,
        1.0 / 11.0,
        1.0 / 9.0,
        1.0 / 7.0,
        1.0 / 5.0,
        1.0 / 3.0,
    ] {
        p = p * z + c;
    }
    // ln m = 2s + 2s·z·p; f − s·f = 2s holds exactly enough and keeps the last bits.
    let tail = s * (f - 2.0 * z * p);
    e * LN2_HI + (f - (tail - e * LN2_LO))
}

/// ln x for positive normal x, single precision.
#[inline(always)]
#[must_use]
pub fn ln_f32(x: f32) -> f32 {
    // Exponent and mantissa split at √½, in integers: what is left of 1 is in [√½ − 1, √2 − 1).
    const SQRT_HALF: u32 = 0x3f35_04f3;
    let t = x.to_bits().wrapping_sub(SQRT_HALF);
    let e = (t as i32 >> 23) as f32;
    let f = f32::from_bits((t & 0x007f_ffff) + SQRT_HALF) - 1.0;
    // (ln(1 + f) − f + f²/2) / f³, minimax of the relative error of ln: 3e-8.
    let mut p = 0.087_004_36;
    for c in [-0.142_674_86, 0.149_147_67, -0.165_775_85, 0.199_630_63, -0.250_013_38, 0.333_339_1f32] {
        p = p * f + c;
    }
    let z = f * f;
    e * std::f32::consts::LN_2 + (f + (p * f * z - 0.5 * z))
}

/// (cos, sin) of the angle `word` · 2π / 2³², single precision.
#[inline(always)]
#[must_use]
pub fn cos_sin_word(word: u32) -> (f32, f32) {
    const QUADRANT: u32 = 1 << 30;
    const RAD: f32 = std::f32::consts::FRAC_PI_2 / QUADRANT as f32;
    let quadrant = word.wrapping_add(QUADRANT / 2) >> 30;
    let r = word.wrapping_sub(quadrant << 30) as i32 as f32 * RAD;
    let z = r * r;
    // Minimax on ±π/4 (Cephes' sinf and cosf).
    let s = r + r * z * (-1.666_665_5e-1 + z * (8.332_161e-3 + z * -1.951_529_6e-4));
    let c = 1.0 - 0.5 * z + z * z * (4.166_664_6e-2 + z * (-1.388_731_6e-3 + z * 2.443_315_7e-5));
    let (c, s) = if quadrant & 1 == 1 { (s, c) } else { (c, s) };
    // Signs by the quadrant's bits: cosine is negative in 1 and 2, sine in 2 and 3.
    let negate = |x: f32, bit: u32| f32::from_bits(x.to_bits() ^ (bit << 31));
    (negate(c, (quadrant ^ (quadrant >> 1)) & 1), negate(s, quadrant >> 1))
}

/// (cos 2πv, sin 2πv) for v in [0, 1].
#[inline(always)]
#[must_use]
pub fn cos_sin_turns(v: f64) -> (f64, f64) {
    let t = 4.0 * v + ROUND;
    let quadrant = t - ROUND;
    let r = (4.0 * v - quadrant) * std::f64::consts::FRAC_PI_2;
    let z = r * r;
    let mut s = -1.0 / 1_307_674_368_000.0;
    for c in
        [1.0 / 6_227_020_800.0, -1.0 / 39_916_800.0, 1.0 / 362_880.0, -1.0 / 5_040.0, 1.0 / 120.0, -1.0 / 6.0]
    {
        s = s * z + c;
    }
    let s = r + r * z * s;
    let mut c = 1.0 / 20_922_789_888_000.0;
    for k in [
        -1.0 / 87_178_291_200.0,
        1.0 / 479_001_600.0,
        -1.0 / 3_628_800.0,
        1.0 / 40_320.0,
        -1.0 / 720.0,
        1.0 / 24.0,
        -0.5,
        1.0,
    ] {
        c = c * z + k;
    }
    let q = t.to_bits() & 3;
    let swap = q & 1 == 1;
    let (cosine, sine) = if swap { (s, c) } else { (c, s) };
    let negate_cos = q == 1 || q == 2;
    let negate_sin = q >= 2;
    (if negate_cos { -cosine } else { cosine }, if negate_sin { -sine } else { sine })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn turns_are_angles(v in 0.0..=1.0f64) {
            let (c, s) = cos_sin_turns(v);
            let a = v * std::f64::consts::TAU;
            prop_assert!((c - a.cos()).abs() < 1e-15 && (s - a.sin()).abs() < 1e-15);
        }

        #[test]
        fn exp_is_exp(x in -700.0..700.0f64) {
            prop_assert!((exp(x) / x.exp() - 1.0).abs() < 1e-15);
        }

        #[test]
        fn ln_is_ln(x in prop_oneof![1e-300..1.0f64, 0.5..2.0f64, 1.0..1e300f64]) {
            prop_assert!((ln(x) - x.ln()).abs() <= 4e-16 * x.ln().abs() + 1e-17, "{} {}", ln(x), x.ln());
        }

        #[test]
        fn single_ln_is_ln(x in prop_oneof![1e-10..1.0f32, 0.5..2.0f32, 0.99..1.01f32]) {
            let exact = f64::from(x).ln();
            prop_assert!((f64::from(ln_f32(x)) - exact).abs() <= 2.5e-7 * exact.abs() + 1e-10, "{} {exact}", ln_f32(x));
        }

        #[test]
        fn words_are_angles(word: u32) {
            let (c, s) = cos_sin_word(word);
            let a = f64::from(word) * std::f64::consts::TAU / 4_294_967_296.0;
            prop_assert!((f64::from(c) - a.cos()).abs() < 1.5e-7 && (f64::from(s) - a.sin()).abs() < 1.5e-7);
        }
    }

    #[test]
    fn exp_underflows_to_almost_nothing() {
        assert!(exp(f64::NEG_INFINITY) < 1e-300 && exp(f64::NEG_INFINITY) >= 0.0);
        assert_eq!(exp(0.0), 1.0);
        assert_eq!(ln(1.0), 0.0);
    }
}
