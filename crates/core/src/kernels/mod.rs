//! The inner loops, compiled for the baseline, for AVX2 and for AVX-512, and chosen at run time.
//!
//! Every loop is written once. No fused multiply–add and no reassociation is used, so the compiled variants give the
//! same bits. This is the only module with `unsafe`; each block states why it is sound.
#![allow(unsafe_code)]
#![allow(
    clippy::needless_range_loop,
    reason = "loops over lanes index several arrays, which is what vectorises"
)]
#![allow(clippy::too_many_arguments, reason = "columns are handed over one by one")]

pub mod jitter;
pub mod landmark;
pub mod likelihood;
pub mod lookup;
pub mod math;
pub mod mixture;
pub mod particles;
pub mod pattern;
pub mod philox;
pub mod team;
#[cfg(test)]
mod variants;
pub mod weights;

/// Instruction sets that loops are compiled for, in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// What every processor of the target has.
    Baseline,
    /// AVX2.
    Avx2,
    /// AVX-512 F, DQ and VL.
    Avx512,
}

#[cfg(test)]
thread_local! {
    /// The best level that a test allows.
    static ALLOWED: std::cell::Cell<Level> = const { std::cell::Cell::new(Level::Avx512) };
}

/// The best level that this processor has.
#[must_use]
#[inline]
pub fn level() -> Level {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::is_x86_feature_detected as has;
        let found = if has!("avx512f") && has!("avx512dq") && has!("avx512vl") && has!("avx2") {
            Level::Avx512
        } else if has!("avx2") {
            Level::Avx2
        } else {
            Level::Baseline
        };
        #[cfg(test)]
        let found = found.min(ALLOWED.get());
        found
    }
    #[cfg(not(target_arch = "x86_64"))]
    Level::Baseline
}

/// Compiles a loop for every [`Level`] and picks at run time.
macro_rules! dispatch {
    ($(#[$meta:meta])* $vis:vis fn $name:ident $(<const $k:ident: usize>)? ($($arg:ident: $ty:ty),* $(,)?) $(-> $ret:ty)? $body:block) => {
        $(#[$meta])*
        #[allow(clippy::too_many_arguments)]
        $vis fn $name $(<const $k: usize>)? ($($arg: $ty),*) $(-> $ret)? {
            #[inline(always)]
            #[allow(clippy::too_many_arguments)]
            fn body $(<const $k: usize>)? ($($arg: $ty),*) $(-> $ret)? $body

            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2")]
                #[allow(clippy::too_many_arguments)]
                fn avx2 $(<const $k: usize>)? ($($arg: $ty),*) $(-> $ret)? {
                    body $(::<$k>)? ($($arg),*)
                }
                #[target_feature(enable = "avx2,avx512f,avx512dq,avx512vl")]
                #[allow(clippy::too_many_arguments)]
                fn avx512 $(<const $k: usize>)? ($($arg: $ty),*) $(-> $ret)? {
                    body $(::<$k>)? ($($arg),*)
                }
                match $crate::kernels::level() {
                    // SAFETY: the processor was just asked and has what the level names.
                    $crate::kernels::Level::Avx512 => return unsafe { avx512 $(::<$k>)? ($($arg),*) },
                    // SAFETY: as above.
                    $crate::kernels::Level::Avx2 => return unsafe { avx2 $(::<$k>)? ($($arg),*) },
                    $crate::kernels::Level::Baseline => {}
                }
            }
            body $(::<$k>)? ($($arg),*)
        }
    };
}
pub(crate) use dispatch;
