//! The inner loops, compiled for the baseline and for AVX2 and chosen at run time.
//!
//! Every loop is written once. No fused multiply–add and no reassociation is used, so the compiled variants give the
//! same bits. This is the only module with `unsafe`; each block states why it is sound.
#![allow(unsafe_code)]
// Lane loops index several arrays at once: that form is what the compiler vectorises.
#![allow(clippy::needless_range_loop)]

pub mod draws;
pub mod likelihood;
pub mod lookup;
pub mod math;
pub mod particles;
pub mod weights;

/// Compiles a loop twice, for the baseline and for AVX2, and picks at run time.
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
                if std::arch::is_x86_feature_detected!("avx2") {
                    // SAFETY: the processor was just asked and has AVX2.
                    return unsafe { avx2 $(::<$k>)? ($($arg),*) };
                }
            }
            body $(::<$k>)? ($($arg),*)
        }
    };
}
pub(crate) use dispatch;
