//! Bilinear lookups of whole rigid patterns, the fast path: one load for the four nodes of a cell.

use super::lookup::{Grid, Paired};
use super::math::floor_split;

/// One point of a rigid pattern: whole cells and the fraction that is left.
#[derive(Debug, Clone, Copy)]
pub struct PatternPoint {
    shift: i32,
    fe: f32,
    fn_: f32,
}

/// A rigid pattern of offsets, split for one grid: the cell and fraction of a particle are found once, and each point is
/// an integer shift with a carry.
#[derive(Debug, Clone, Default)]
pub struct Pattern {
    points: Vec<PatternPoint>,
    /// Bounds of the offsets, m: west, south, east, north.
    reach_m: [f64; 4],
    /// Columns and cell of the grids that it is split for.
    split_for: (usize, f64),
}

impl Pattern {
    /// Splits `offsets` (east, north; m) for grids of this geometry, reusing the memory.
    pub fn set<T>(&mut self, grid: &Grid<'_, T>, offsets: impl Iterator<Item = [f64; 2]>) {
        self.points.clear();
        self.reach_m = [0.0; 4];
        self.split_for = (grid.cols, grid.cell_m);
        for [e, n] in offsets {
            let (x, y) = (e / grid.cell_m, n / grid.cell_m);
            let (column, row) = (x.floor(), y.floor());
            self.points.push(PatternPoint {
                // Wraps only for offsets that no grid holds; `fits` refuses those.
                shift: (row as i32).wrapping_mul(grid.cols as i32).wrapping_add(column as i32),
                fe: (x - column) as f32,
                fn_: (y - row) as f32,
            });
            let [w, s, east, north] = self.reach_m;
            self.reach_m = [w.min(e), s.min(n), east.max(e), north.max(n)];
        }
    }

    /// Number of points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// True if there are no points.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// True if every point of the pattern stays on the grid, a cell away from its edge, for positions in these bounds.
    #[must_use]
    pub fn fits<T>(&self, grid: &Grid<'_, T>, min_m: [f64; 2], max_m: [f64; 2]) -> bool {
        let margin = 2.0 * grid.cell_m;
        let [west, south, east, north] = self.reach_m;
        // Shifts are those of one width: on another grid they would lead anywhere.
        self.split_for == (grid.cols, grid.cell_m)
            && min_m[0] + west >= grid.east0_m + margin
            && min_m[1] + south >= grid.north0_m + margin
            && max_m[0] + east <= grid.east0_m + (grid.cols - 1) as f64 * grid.cell_m - margin
            && max_m[1] + north <= grid.north0_m + (grid.rows - 1) as f64 * grid.cell_m - margin
    }
}

/// Particles of a block.
pub const LANES: usize = 16;

/// Cells and fractions of up to `LANES` particles.
struct Cells {
    index: [i32; LANES],
    fe: [f32; LANES],
    fn_: [f32; LANES],
}

#[inline(always)]
fn cells(grid: &Grid<'_, Paired>, east_m: &[f64], north_m: &[f64]) -> Cells {
    let n = east_m.len().min(north_m.len()).min(LANES);
    // Unused lanes repeat the first particle: they read what is known to be on the grid.
    let (mut east, mut north) = ([east_m[0]; LANES], [north_m[0]; LANES]);
    if let (Some(e), Some(n)) = (east_m.first_chunk::<LANES>(), north_m.first_chunk::<LANES>()) {
        (east, north) = (*e, *n);
    } else {
        east[..n].copy_from_slice(&east_m[..n]);
        north[..n].copy_from_slice(&north_m[..n]);
    }
    let mut c = Cells { index: [0; LANES], fe: [0.0; LANES], fn_: [0.0; LANES] };
    let inverse = 1.0 / grid.cell_m;
    for l in 0..LANES {
        let (column, fe) = floor_split((east[l] - grid.east0_m) * inverse);
        let (row, fn_) = floor_split((north[l] - grid.north0_m) * inverse);
        c.index[l] = row.wrapping_mul(grid.cols as i32).wrapping_add(column);
        c.fe[l] = fe as f32;
        c.fn_[l] = fn_ as f32;
    }
    c
}

/// Where one pattern point of a block of particles falls: the first node of each cell, and the fractions.
#[derive(Clone, Copy)]
struct Aim {
    at: [u32; LANES],
    fe: [f32; LANES],
    fn_: [f32; LANES],
}

const NO_AIM: Aim = Aim { at: [0; LANES], fe: [0.0; LANES], fn_: [0.0; LANES] };

/// Points that are aimed at before the first depth is loaded: then loads need not wait for arithmetic.
const AIMS: usize = 16;

/// How a block of particles is aimed and loaded.
trait Loads {
    /// Aims at `point`; `cols` is the grid's.
    ///
    /// # Safety
    /// The processor must have what this is made of.
    unsafe fn aim(&self, cells: &Cells, point: PatternPoint, cols: i32) -> Aim;

    /// Depths of one pattern point for a block of particles, f32.
    ///
    /// # Safety
    /// Each cell must lie on the grid ([`Pattern::fits`]), and the processor must have what the loads are made of.
    unsafe fn load(&self, grid: &Grid<'_, Paired>, aim: &Aim) -> [f32; LANES];
}

/// One particle after the other.
struct Scalar;

impl Loads for Scalar {
    #[inline(always)]
    unsafe fn aim(&self, cells: &Cells, point: PatternPoint, cols: i32) -> Aim {
        let mut aim = NO_AIM;
        for l in 0..LANES {
            let (fe, fn_) = (cells.fe[l] + point.fe, cells.fn_[l] + point.fn_);
            let (carry_e, carry_n) = (fe >= 1.0, fn_ >= 1.0);
            aim.fe[l] = if carry_e { fe - 1.0 } else { fe };
            aim.fn_[l] = if carry_n { fn_ - 1.0 } else { fn_ };
            let index = cells.index[l].wrapping_add(point.shift);
            let index = index.wrapping_add(if carry_e { 1 } else { 0 });
            aim.at[l] = index.wrapping_add(if carry_n { cols } else { 0 }) as u32;
        }
        aim
    }

    #[inline(always)]
    unsafe fn load(&self, grid: &Grid<'_, Paired>, aim: &Aim) -> [f32; LANES] {
        let mut out = [0.0f32; LANES];
        for l in 0..LANES {
            let at = aim.at[l] as usize;
            debug_assert!(at + 1 < grid.values.len());
            // SAFETY: the caller's promise; the west and the east of a cell that is inside the grid.
            let ([sw, nw], [se, ne]) =
                unsafe { (*grid.values.get_unchecked(at), *grid.values.get_unchecked(at + 1)) };
            let south = sw + aim.fe[l] * (se - sw);
            let north = nw + aim.fe[l] * (ne - nw);
            out[l] = south + aim.fn_[l] * (north - south);
        }
        out
    }
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use super::{Aim, Cells, Grid, LANES, Loads, NO_AIM, Paired, PatternPoint};
    use std::arch::x86_64::*;

    /// Eight particles at a time.
    pub(super) struct Vector;

    impl Loads for Vector {
        #[inline(always)]
        unsafe fn aim(&self, cells: &Cells, point: PatternPoint, cols: i32) -> Aim {
            // SAFETY: the caller's promise.
            unsafe { aim(cells, point, cols) }
        }

        #[inline(always)]
        unsafe fn load(&self, grid: &Grid<'_, Paired>, aim: &Aim) -> [f32; LANES] {
            // SAFETY: the caller's promise.
            unsafe { point_depths(grid, aim) }
        }
    }

    /// By hand: the compiler makes masked stores of the choices, which are slow.
    ///
    /// # Safety
    /// The processor has AVX2.
    #[inline]
    #[target_feature(enable = "avx2")]
    unsafe fn aim(cells: &Cells, point: PatternPoint, cols: i32) -> Aim {
        let mut aim = NO_AIM;
        let one = _mm256_set1_ps(1.0);
        for o in [0, 8] {
            // SAFETY: loads and stores stay inside the arrays of LANES entries.
            unsafe {
                let fe = _mm256_add_ps(_mm256_loadu_ps(cells.fe.as_ptr().add(o)), _mm256_set1_ps(point.fe));
                let fn_ =
                    _mm256_add_ps(_mm256_loadu_ps(cells.fn_.as_ptr().add(o)), _mm256_set1_ps(point.fn_));
                let carry_e = _mm256_cmp_ps::<_CMP_GE_OQ>(fe, one);
                let carry_n = _mm256_cmp_ps::<_CMP_GE_OQ>(fn_, one);
                let index = _mm256_loadu_si256(cells.index.as_ptr().add(o).cast());
                let index = _mm256_add_epi32(index, _mm256_set1_epi32(point.shift));
                let index = _mm256_sub_epi32(index, _mm256_castps_si256(carry_e));
                let row = _mm256_and_si256(_mm256_castps_si256(carry_n), _mm256_set1_epi32(cols));
                _mm256_storeu_si256(aim.at.as_mut_ptr().add(o).cast(), _mm256_add_epi32(index, row));
                let fe = _mm256_sub_ps(fe, _mm256_and_ps(carry_e, one));
                let fn_ = _mm256_sub_ps(fn_, _mm256_and_ps(carry_n, one));
                _mm256_storeu_ps(aim.fe.as_mut_ptr().add(o), fe);
                _mm256_storeu_ps(aim.fn_.as_mut_ptr().add(o), fn_);
            }
        }
        aim
    }

    /// One 16-byte load for each cell. Gathers cost twice.
    ///
    /// # Safety
    /// The processor has AVX2, and the promise of [`Loads::load`].
    #[inline]
    #[target_feature(enable = "avx2")]
    unsafe fn point_depths(grid: &Grid<'_, Paired>, aim: &Aim) -> [f32; LANES] {
        let mut out = [0.0f32; LANES];
        debug_assert!(aim.at.iter().all(|at| *at as usize + 1 < grid.values.len()));
        for o in [0, 8] {
            // SAFETY: loads and stores stay inside the arrays of LANES entries; nodes by the caller's promise.
            unsafe {
                let at = &*aim.at.as_ptr().add(o).cast::<[u32; 8]>();
                let fe = _mm256_loadu_ps(aim.fe.as_ptr().add(o));
                let fn_ = _mm256_loadu_ps(aim.fn_.as_ptr().add(o));
                let depth = eight(grid.values.as_ptr().cast(), at, fe, fn_);
                _mm256_storeu_ps(out.as_mut_ptr().add(o), depth);
            }
        }
        out
    }

    /// Depths in eight cells: wests and easts of two particles side by side, south before north, until the last step.
    ///
    /// # Safety
    /// The processor has AVX2; the four floats from `2 · at` on can be read from `nodes`.
    #[inline]
    #[target_feature(enable = "avx2")]
    unsafe fn eight(nodes: *const f32, at: &[u32; 8], fe: __m256, fn_: __m256) -> __m256 {
        // SAFETY: the caller's promise.
        let cell = |l: usize| unsafe { _mm_loadu_ps(nodes.add(2 * at[l] as usize)) };
        // [sw nw se ne] of a particle in the lower half and of the fourth after it in the upper.
        let two = |l: usize| _mm256_set_m128(cell(l + 4), cell(l));
        let between = |a: __m256, b: __m256, fe: __m256| {
            let (west, east) = (_mm256_unpacklo_ps(a, b), _mm256_unpackhi_ps(a, b));
            _mm256_castps_pd(_mm256_add_ps(west, _mm256_mul_ps(fe, _mm256_sub_ps(east, west))))
        };
        let fe = _mm256_castps_pd(fe);
        let first = between(two(0), two(1), _mm256_castpd_ps(_mm256_unpacklo_pd(fe, fe)));
        let second = between(two(2), two(3), _mm256_castpd_ps(_mm256_unpackhi_pd(fe, fe)));
        let south = _mm256_castpd_ps(_mm256_unpacklo_pd(first, second));
        let north = _mm256_castpd_ps(_mm256_unpackhi_pd(first, second));
        _mm256_add_ps(south, _mm256_mul_ps(fn_, _mm256_sub_ps(north, south)))
    }
}

/// What is done with the depths of a block of particles.
///
/// A trait and not a closure: methods can be inlined for sure, so that they are compiled for AVX2 with the lookups and
/// keep their sums in registers.
pub trait Block {
    /// Depths at the points from the `k`-th on, a few at a time and in order, for the particles `first..first + count`;
    /// lanes from `count` on repeat the first particle.
    fn take(&mut self, first: usize, count: usize, k: usize, depths: &[[f32; LANES]]);

    /// All points of these particles have come.
    fn finish(&mut self, first: usize, count: usize);
}

struct EachPoint<F>(F);

impl<F: FnMut(usize, usize, usize, &[f32; LANES])> Block for EachPoint<F> {
    #[inline(always)]
    fn take(&mut self, first: usize, count: usize, k: usize, depths: &[[f32; LANES]]) {
        for (later, depths) in depths.iter().enumerate() {
            (self.0)(first, count, k + later, depths);
        }
    }

    #[inline(always)]
    fn finish(&mut self, _: usize, _: usize) {}
}

/// Depths of every pattern point of every particle, handed over in blocks: `sink(first, count, point, depths)`.
///
/// Returns false, and calls nothing, where the pattern does not fit ([`Pattern::fits`]).
pub fn pattern_depths(
    grid: &Grid<'_, Paired>,
    pattern: &Pattern,
    east_m: &[f64],
    north_m: &[f64],
    sink: impl FnMut(usize, usize, usize, &[f32; LANES]),
) -> bool {
    pattern_blocks(grid, pattern, east_m, north_m, EachPoint(sink))
}

/// Depths of every pattern point of every particle, one row of `stride` for each point, from `first` of each row on.
///
/// Returns false, and writes nothing, where the pattern does not fit ([`Pattern::fits`]) or `out` is too short.
pub fn pattern_rows(
    grid: &Grid<'_, Paired>,
    pattern: &Pattern,
    east_m: &[f64],
    north_m: &[f64],
    out: &mut [f32],
    stride: usize,
    first: usize,
) -> bool {
    let n = east_m.len().min(north_m.len());
    first + n <= stride
        && out.len() >= pattern.len() * stride
        && pattern_blocks(grid, pattern, east_m, north_m, Rows { out, stride, first })
}

struct Rows<'a> {
    out: &'a mut [f32],
    stride: usize,
    first: usize,
}

impl Block for Rows<'_> {
    #[inline(always)]
    fn take(&mut self, first: usize, count: usize, k: usize, depths: &[[f32; LANES]]) {
        let mut at = k * self.stride + self.first + first;
        for depths in depths {
            debug_assert!(at + count <= self.out.len());
            // SAFETY: `pattern_rows` has seen that every row holds all particles from `first` on.
            unsafe {
                let row = self.out.as_mut_ptr().add(at);
                if count == LANES {
                    row.cast::<[f32; LANES]>().write_unaligned(*depths);
                } else {
                    std::ptr::copy_nonoverlapping(depths.as_ptr(), row, count);
                }
            }
            at += self.stride;
        }
    }

    #[inline(always)]
    fn finish(&mut self, _: usize, _: usize) {}
}

/// As [`pattern_depths`], block by block.
pub fn pattern_blocks(
    grid: &Grid<'_, Paired>,
    pattern: &Pattern,
    east_m: &[f64],
    north_m: &[f64],
    block: impl Block,
) -> bool {
    let n = east_m.len().min(north_m.len());
    let Some((min, max)) = bounds(&east_m[..n], &north_m[..n]) else { return false };
    if !pattern.fits(grid, min, max) {
        return false;
    }
    #[cfg(target_arch = "x86_64")]
    if super::level() >= super::Level::Avx2 {
        // SAFETY: AVX2 was detected, and `fits` holds for the bounds of all positions.
        unsafe { blocks_avx2(grid, pattern, &east_m[..n], &north_m[..n], block) };
        return true;
    }
    // SAFETY: as above.
    unsafe { blocks(grid, pattern, &east_m[..n], &north_m[..n], block, &Scalar) };
    true
}

/// Every block of particles.
///
/// # Safety
/// The pattern fits the grid for the bounds of all positions, so every cell is on the grid with a margin of two cells
/// (rounding of offsets and fractions moves a point by far less). The processor has what `loads` is made of.
#[inline(always)]
unsafe fn blocks(
    grid: &Grid<'_, Paired>,
    pattern: &Pattern,
    east_m: &[f64],
    north_m: &[f64],
    mut block: impl Block,
    loads: &impl Loads,
) {
    let (mut aims, mut depths) = ([NO_AIM; AIMS], [[0.0; LANES]; AIMS]);
    for (index, (e, n)) in east_m.chunks(LANES).zip(north_m.chunks(LANES)).enumerate() {
        let cells = cells(grid, e, n);
        let (first, count) = (index * LANES, e.len().min(n.len()));
        for (part, points) in pattern.points.chunks(AIMS).enumerate() {
            for (point, aim) in points.iter().zip(&mut aims) {
                // SAFETY: the caller's promise.
                *aim = unsafe { loads.aim(&cells, *point, grid.cols as i32) };
            }
            for (depths, aim) in depths.iter_mut().zip(&aims[..points.len()]) {
                // SAFETY: the caller's promise.
                *depths = unsafe { loads.load(grid, aim) };
            }
            block.take(first, count, part * AIMS, &depths[..points.len()]);
        }
        block.finish(first, count);
    }
}

/// As `blocks`, compiled for AVX2.
///
/// # Safety
/// The processor has AVX2, and the promise of `blocks`.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
unsafe fn blocks_avx2(
    grid: &Grid<'_, Paired>,
    pattern: &Pattern,
    east_m: &[f64],
    north_m: &[f64],
    block: impl Block,
) {
    // SAFETY: the caller's promise.
    unsafe { blocks(grid, pattern, east_m, north_m, block, &avx2::Vector) };
}

super::dispatch! {
    /// Bounds of positions, m: ((west, south), (east, north)); `None` for no positions or one that is not finite.
    pub fn bounds(east_m: &[f64], north_m: &[f64]) -> Option<([f64; 2], [f64; 2])> {
        const WIDE: usize = 8;
        let n = east_m.len().min(north_m.len());
        let mut lanes = Lanes {
            low: [[f64::INFINITY; WIDE]; 2],
            high: [[f64::NEG_INFINITY; WIDE]; 2],
            size: [0.0; WIDE],
        };
        let ((e, e_rest), (n_, n_rest)) = (east_m[..n].as_chunks::<WIDE>(), north_m[..n].as_chunks::<WIDE>());
        for (e, n) in e.iter().zip(n_) {
            for l in 0..WIDE {
                lanes.take(l, e[l], n[l]);
            }
        }
        for (l, (e, n)) in e_rest.iter().zip(n_rest).enumerate() {
            lanes.take(l, *e, *n);
        }
        let low = lanes.low.map(|l| l.into_iter().fold(f64::INFINITY, f64::min));
        let high = lanes.high.map(|l| l.into_iter().fold(f64::NEG_INFINITY, f64::max));
        // A sum keeps a NaN and an infinity, and is finite for anything that a chart could hold.
        let finite = lanes.size.iter().sum::<f64>() < 1e300;
        (finite && n > 0).then_some((low, high))
    }
}

/// Running bounds in eight lanes.
struct Lanes {
    low: [[f64; 8]; 2],
    high: [[f64; 8]; 2],
    size: [f64; 8],
}

impl Lanes {
    #[inline(always)]
    fn take(&mut self, l: usize, e: f64, n: f64) {
        for (axis, x) in [e, n].into_iter().enumerate() {
            let (low, high) = (self.low[axis][l], self.high[axis][l]);
            self.low[axis][l] = if x < low { x } else { low };
            self.high[axis][l] = if x > high { x } else { high };
        }
        self.size[l] += e.abs() + n.abs();
    }
}

#[cfg(test)]
#[allow(clippy::panic, reason = "tests fail by panicking")]
mod tests {
    use super::super::lookup::{bilinear, paired};
    use super::*;
    use proptest::prelude::*;

    fn wavy(rows: usize, cols: usize) -> Vec<Paired> {
        let values: Vec<f32> = (0..rows * cols)
            .map(|i| {
                let (r, c) = ((i / cols) as f32, (i % cols) as f32);
                15.0 + 6.0 * (0.11 * r).sin() + 5.0 * (0.07 * c + 0.05 * r).cos()
            })
            .collect();
        paired(&values, cols)
    }

    proptest! {
        #[test]
        fn patterns_meet_single_lookups(
            seeds in prop::collection::vec((20.0..80.0f64, 20.0..60.0f64), 1..70),
            offsets in prop::collection::vec((-15.0..15.0f64, -15.0..15.0f64), 1..16),
            cell in prop_oneof![Just(1.0f64), Just(0.7), Just(2.5)],
        ) {
            let (rows, cols) = (90, 110);
            let values = wavy(rows, cols);
            let grid = Grid::new(&values, rows, cols, 3500.0, -1200.0, cell).unwrap();
            let east: Vec<f64> = seeds.iter().map(|s| 3500.0 + cell * s.0).collect();
            let north: Vec<f64> = seeds.iter().map(|s| -1200.0 + cell * s.1).collect();
            let mut pattern = Pattern::default();
            pattern.set(&grid, offsets.iter().map(|o| [cell * o.0, cell * o.1]));
            let mut got = vec![f32::NAN; seeds.len() * offsets.len()];
            let inside = pattern_depths(&grid, &pattern, &east, &north, |first, count, k, d| {
                for l in 0..count {
                    got[(first + l) * offsets.len() + k] = d[l];
                }
            });
            prop_assert!(inside);
            for (i, (e, n)) in east.iter().zip(&north).enumerate() {
                for (k, o) in offsets.iter().enumerate() {
                    let exact = bilinear(&grid, e + cell * o.0, n + cell * o.1);
                    prop_assert!((f64::from(got[i * offsets.len() + k]) - exact).abs() < 3e-4);
                }
            }
            // The variants agree bit for bit.
            let c = cells(&grid, &east[..east.len().min(16)], &north[..north.len().min(16)]);
            #[cfg(target_arch = "x86_64")]
            if std::arch::is_x86_feature_detected!("avx2") {
                for p in &pattern.points {
                    let bits = |loads: &dyn Loads| unsafe {
                        let aim = loads.aim(&c, *p, cols as i32);
                        (aim.at, loads.load(&grid, &aim).map(f32::to_bits))
                    };
                    prop_assert_eq!(bits(&Scalar), bits(&avx2::Vector));
                }
            }
        }
    }

    #[test]
    fn a_pattern_split_for_another_width_is_refused() {
        let values = wavy(20, 20);
        let grid = Grid::new(&values, 20, 20, 0.0, 0.0, 1.0).unwrap();
        let (narrow, wide) = (wavy(20, 10), wavy(20, 40));
        let mut pattern = Pattern::default();
        pattern.set(&grid, [[0.0, 0.0], [1.5, 3.5]].into_iter());
        for (values, cols) in [(&narrow, 10), (&wide, 40)] {
            let other = Grid::new(values, 20, cols, 0.0, 0.0, 1.0).unwrap();
            assert!(!pattern_depths(&other, &pattern, &[5.0], &[8.0], |_, _, _, _| panic!("no lookup")));
        }
    }

    /// Every load is asserted to lie on the grid while assertions are on, here up to the edge and past it, at the
    /// furthest places that a grid may have.
    #[test]
    fn no_lookup_leaves_the_grid() {
        let values = wavy(24, 24);
        for (zero_m, cell_m) in [(0.0, 1.0), (-1e8, 1e-3), (1e8 - 23.0, 1.0), (9e7, 1e5), (1e8 - 1.0, 0.03)] {
            let Ok(grid) = Grid::new(&values, 24, 24, zero_m, -zero_m.abs(), cell_m) else {
                assert!(zero_m == 9e7 && cell_m == 1e5, "{zero_m} {cell_m}");
                continue;
            };
            let mut pattern = Pattern::default();
            pattern.set(&grid, [[0.0, 0.0], [1.9 * cell_m, -1.9 * cell_m]].into_iter());
            for k in -20..270 {
                let along = f64::from(k) * 0.1 * cell_m;
                let (east, north) = (zero_m + along, -zero_m.abs() + along);
                for at in
                    [[east, north], [east, f64::NAN], [1e18, north], [east, -1e18], [f64::MAX, f64::MIN]]
                {
                    pattern_depths(&grid, &pattern, &[at[0]; 3], &[at[1]; 3], |_, _, _, _| ());
                    let _ = bilinear(&grid, at[0], at[1]);
                }
            }
        }
    }

    #[test]
    fn a_pattern_that_reaches_over_the_edge_is_refused() {
        let values = wavy(20, 20);
        let grid = Grid::new(&values, 20, 20, 0.0, 0.0, 1.0).unwrap();
        let mut pattern = Pattern::default();
        pattern.set(&grid, [[0.0, 0.0], [-6.0, 0.0]].into_iter());
        assert!(!pattern_depths(&grid, &pattern, &[7.0], &[10.0], |_, _, _, _| panic!("no lookup")));
        assert!(!pattern_depths(&grid, &pattern, &[f64::NAN], &[10.0], |_, _, _, _| panic!("no lookup")));
        assert!(pattern_depths(&grid, &pattern, &[9.0], &[10.0], |_, _, _, _| ()));
    }
}
