//! Philox4x32-10 (Salmon et al. 2011), and the normals and uniforms made of its words.

use super::dispatch;
use super::math::{cos_sin_word, ln_f32};

const LANES: usize = 16;
const PER_WORD: f64 = 1.0 / 4_294_967_296.0;

/// What selects a stream: Philox's key, and the two words of its counter that are the same for all draws of the stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StreamKey {
    /// Low and high word of the seed.
    pub seed: [u32; 2],
    /// Counts the streams of one purpose.
    pub step: u32,
    /// Vehicle and purpose.
    pub who: u32,
}

/// Pairs of normals that one call of the generator gives.
pub(super) const PAIRS: usize = 2 * LANES;

/// Four words of each lane; only the low halves count. In 64-bit lanes a product needs no shuffling.
type Words = [[u64; LANES]; 4];

/// Ten rounds for `LANES` consecutive blocks of a stream.
#[inline(always)]
fn philox(stream: &StreamKey, lane: u32, first_block: u32) -> Words {
    const M0: u64 = 0xD251_1F53;
    const M1: u64 = 0xCD9E_8D57;
    const LOW: u64 = 0xFFFF_FFFF;
    let mut x: Words = [[0; LANES]; 4];
    for l in 0..LANES {
        x[0][l] = u64::from(first_block.wrapping_add(l as u32));
        x[1][l] = u64::from(lane);
        x[2][l] = u64::from(stream.step);
        x[3][l] = u64::from(stream.who);
    }
    let [mut k0, mut k1] = stream.seed;
    for _ in 0..10 {
        for l in 0..LANES {
            let p0 = M0 * (x[0][l] & LOW);
            let p1 = M1 * (x[2][l] & LOW);
            x[0][l] = (p1 >> 32) ^ x[1][l] ^ u64::from(k0);
            x[1][l] = p1;
            x[2][l] = (p0 >> 32) ^ x[3][l] ^ u64::from(k1);
            x[3][l] = p0;
        }
        k0 = k0.wrapping_add(0x9E37_79B9);
        k1 = k1.wrapping_add(0xBB67_AE85);
    }
    x
}

/// u32 → f64 through the exponent trick, which vectorises.
#[inline(always)]
fn to_f64(word: u32) -> f64 {
    const TWO_52: f64 = 4_503_599_627_370_496.0;
    f64::from_bits(0x4330_0000_0000_0000 | u64::from(word)) - TWO_52
}

/// A standard exponential, −ln of a uniform in (0, 1).
#[inline(always)]
fn exponential(word: u32) -> f32 {
    const PER_31_BITS: f32 = 1.0 / 2_147_483_648.0;
    const BELOW_ONE: f32 = 1.0 - f32::EPSILON / 2.0;
    let u = (word >> 1) as i32 as f32 * PER_31_BITS + 0.5 * PER_31_BITS;
    -ln_f32(if u < BELOW_ONE { u } else { BELOW_ONE })
}

/// Box–Muller on two words: 32 bits reach 6.6 σ, far past what a cloud of particles resolves.
///
/// In f32: a normal's relative error of 3e-7 is nothing beside the noise that it stands for, and twice as many fit in a
/// vector.
#[inline(always)]
fn box_muller(first: u32, second: u32) -> (f32, f32) {
    let radius = (2.0 * exponential(first)).sqrt();
    let (c, s) = cos_sin_word(second);
    (radius * c, radius * s)
}

/// The pairs `PAIRS · go ..` of the stream's `lane`.
#[inline(always)]
pub(super) fn pairs(stream: &StreamKey, lane: u32, go: usize) -> [[f32; PAIRS]; 2] {
    let x = philox(stream, lane, (go * LANES) as u32);
    let mut words = [[0u32; PAIRS]; 2];
    for l in 0..LANES {
        (words[0][l], words[1][l]) = (x[0][l] as u32, x[1][l] as u32);
        (words[0][LANES + l], words[1][LANES + l]) = (x[2][l] as u32, x[3][l] as u32);
    }
    let mut p = [[0.0; PAIRS]; 2];
    for l in 0..PAIRS {
        (p[0][l], p[1][l]) = box_muller(words[0][l], words[1][l]);
    }
    p
}

dispatch! {
    /// Fills `a[i], b[i]` with the i-th pair of standard normals of the stream's `lane`.
    pub fn normal_pairs(stream: &StreamKey, lane: u32, a: &mut [f64], b: &mut [f64]) {
        for (go, (a, b)) in a.chunks_mut(PAIRS).zip(b.chunks_mut(PAIRS)).enumerate() {
            let p = pairs(stream, lane, go);
            for (out, p) in [a, b].into_iter().zip(&p) {
                out.iter_mut().zip(p).for_each(|(out, p)| *out = f64::from(*p));
            }
        }
    }
}

dispatch! {
    /// Fills `out[i]` with the i-th uniform in (0, 1) of the stream's `lane`.
    pub fn uniforms(stream: &StreamKey, lane: u32, out: &mut [f64]) {
        for (block, out) in out.chunks_mut(2 * LANES).enumerate() {
            let x = philox(stream, lane, (block * LANES) as u32);
            let mut u = [0.0; 2 * LANES];
            for l in 0..LANES {
                // 32 high bits and 20 low ones: a 52-bit number, centred in its cell, below 1.
                u[l] = (to_f64(x[0][l] as u32) + (to_f64(x[1][l] as u32 >> 12) + 0.5) / 1_048_576.0) * PER_WORD;
                u[LANES + l] = (to_f64(x[2][l] as u32) + (to_f64(x[3][l] as u32 >> 12) + 0.5) / 1_048_576.0) * PER_WORD;
            }
            out.copy_from_slice(&u[..out.len()]);
        }
    }
}

dispatch! {
    /// Fills `out` with as many uniforms in (0, 1), ascending: the sums of exponential spacings over the sum with one more.
    pub fn sorted_uniforms(stream: &StreamKey, lane: u32, out: &mut [f64]) {
        const GROUP: usize = 8;
        const WORDS: usize = 4 * LANES;
        let n = out.len();
        let (mut carry, mut all) = (0.0, 1.0);
        for block in 0..=n / WORDS {
            let x = philox(stream, lane, (block * LANES) as u32);
            let mut sums = [0.0; WORDS];
            for w in 0..4 {
                for l in 0..LANES {
                    sums[w * LANES + l] = f64::from(exponential(x[w][l] as u32));
                }
            }
            // Sums begin anew in each group, so that only one addition in eight waits for the one before.
            for group in sums.as_chunks_mut::<GROUP>().0 {
                for l in 1..GROUP {
                    group[l] += group[l - 1];
                }
                let before = carry;
                carry += group[GROUP - 1];
                for sum in group {
                    *sum += before;
                }
            }
            let first = block * WORDS;
            if let Some(out) = out.get_mut(first..first + WORDS) {
                out.copy_from_slice(&sums);
            } else {
                out[first..].copy_from_slice(&sums[..n - first]);
                all = sums[n - first];
            }
        }
        let scale = 1.0 / all;
        out.iter_mut().for_each(|x| *x *= scale);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Known answers of the Random123 distribution: counter and key all zeros, all ones, and digits of π.
    #[test]
    fn philox_gives_the_published_answers() {
        let run = |counter: [u32; 4], key: [u32; 2]| {
            let stream = StreamKey { seed: key, step: counter[2], who: counter[3] };
            let x = philox(&stream, counter[1], counter[0]);
            [0, 1, 2, 3].map(|w| x[w][0] as u32)
        };
        assert_eq!(run([0; 4], [0; 2]), [0x6627_e8d5, 0xe169_c58d, 0xbc57_ac4c, 0x9b00_dbd8]);
        assert_eq!(run([u32::MAX; 4], [u32::MAX; 2]), [0x408f_276d, 0x41c8_3b0e, 0xa20b_c7c6, 0x6d54_51fd]);
        assert_eq!(
            run([0x243f_6a88, 0x85a3_08d3, 0x1319_8a2e, 0x0370_7344], [0xa409_3822, 0x299f_31d0]),
            [0xd16c_fe09, 0x94fd_cceb, 0x5001_e420, 0x2412_6ea1]
        );
    }
}
