//! Resampling and regularisation of a cloud: which particles live on, and how copies are moved apart.

use super::Cloud;
use crate::kernels::particles::{gather, liu_west, liu_west_bandwidth, roughen_drawn};
use crate::kernels::weights;
use crate::random::Stream;

impl<const K: usize> Cloud<K> {
    /// Residual resampling; all columns follow their particle, weights become equal. Returns (ancestors, counts).
    pub fn resample(&mut self, stream: &Stream) {
        let n = self.len();
        self.scratch.fit(n);
        let s = &mut self.scratch;
        let left = weights::residual_copies(&self.weights, &mut s.cdf, &mut s.counts);
        // In order, so that what they select is walked through and not jumped about in.
        stream.sorted_uniforms(0, &mut s.a[..left]);
        weights::residual_draw(&s.a[..left], &s.cdf, &mut s.counts, &mut s.ancestors);
        for column in [&mut self.east, &mut self.north, &mut self.offset, &mut self.offset_variance]
            .into_iter()
            .chain(&mut self.linear)
            .filter(|column| column.len() == n)
        {
            gather(column, &mut s.column, &s.ancestors);
        }
        self.equalise();
    }

    /// Becomes `count` equally weighted particles drawn from `source` at regular steps of its summed weights, so that two
    /// draws of one cloud differ by at most one copy of a particle.
    pub fn draw_from(&mut self, source: &Self, count: usize, stream: &Stream) {
        let mut start = [0.0];
        stream.uniforms(0, &mut start);
        self.scratch.ancestors.clear();
        let (mut sum, step) = (0.0, 1.0 / count as f64);
        for (i, weight) in source.weights.iter().enumerate() {
            sum += weight;
            // Rounding may leave the sum a little below 1: the last particle takes what is left.
            let until = if i + 1 == source.len() { f64::INFINITY } else { sum };
            while self.scratch.ancestors.len() < count
                && (self.scratch.ancestors.len() as f64 + start[0]) * step < until
            {
                self.scratch.ancestors.push(i as u32);
            }
        }
        let ancestors = &self.scratch.ancestors;
        let take = |to: &mut Vec<f64>, from: &[f64]| {
            to.clear();
            to.extend(ancestors.iter().map(|a| from[*a as usize]));
        };
        take(&mut self.east, &source.east);
        take(&mut self.north, &source.north);
        for (to, from) in self.linear.iter_mut().zip(&source.linear) {
            take(to, from);
        }
        if !source.offset.is_empty() {
            take(&mut self.offset, &source.offset);
            take(&mut self.offset_variance, &source.offset_variance);
        }
        self.weights.resize(count, 0.0);
        self.log_weights.resize(count, 0.0);
        self.equalise();
    }

    /// Whom each particle was copied from in the last [`Cloud::resample`].
    #[must_use]
    pub fn ancestors(&self) -> &[u32] {
        &self.scratch.ancestors
    }

    /// The paper's roughening of the particles that the last [`Cloud::resample`] copied more than once.
    pub fn roughen(&mut self, variance_m2: f64, stream: &Stream) {
        self.scratch.fit(self.east.len());
        roughen_drawn(&mut self.east, &mut self.north, &self.scratch.ancestors, variance_m2, stream.key());
    }

    /// Liu–West on the joint [east, north, offset, linear…] of an equally weighted cloud.
    pub fn liu_west(&mut self, stream: &Stream) {
        let n = self.len();
        self.scratch.fit(n);
        let h = liu_west_bandwidth(n);
        let [n0, n1, n2, n3, n4, n5] = &mut self.scratch.more;
        stream.normal_pairs(0, n0, n1);
        stream.normal_pairs(1, n2, n3);
        stream.normal_pairs(2, n4, n5);
        let extra = &mut self.scratch.a;
        if K > 3 {
            stream.normal_pairs(3, extra, &mut self.scratch.b);
        }
        let (e, nn, b) = (&mut self.east[..], &mut self.north[..], &mut self.offset[..]);
        match self.linear.as_mut_slice() {
            [c0, c1] => liu_west(&mut [e, nn, b, c0, c1], h, &[n0, n1, n2, n3, n4]),
            [c0, c1, c2, c3] => {
                liu_west(&mut [e, nn, b, c0, c1, c2, c3], h, &[n0, n1, n2, n3, n4, n5, extra]);
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::cloud::Cloud;
    use crate::random::{Purpose, Streams};

    #[test]
    fn a_draw_copies_each_particle_by_its_weight() {
        let mut source = Cloud::<2>::new(5);
        source.add_offset();
        source.east = vec![0.0, 1.0, 2.0, 3.0, 4.0];
        source.offset = vec![0.0, 0.1, 0.2, 0.3, 0.4];
        let shares = [0.0f64, 0.1, 0.2, 0.3, 0.4];
        assert!(source.reweight(shares.iter().map(|s| s.ln()).collect()));
        for step in 0..50 {
            let mut drawn = Cloud::<2>::new(0);
            drawn.draw_from(&source, 1003, &Streams::new(3, 0).at(Purpose::Acquisition, step));
            assert!(drawn.is_consistent() && drawn.len() == 1003);
            assert!((drawn.weights()[7] - 1.0 / 1003.0).abs() < 1e-15 && (drawn.ess() - 1003.0).abs() < 1e-9);
            for (k, share) in shares.iter().enumerate() {
                let copies = drawn.east.iter().filter(|e| **e == k as f64).count() as f64;
                assert!((copies - 1003.0 * share).abs() <= 1.0, "{copies} of {k}");
            }
            assert!(drawn.east.iter().zip(&drawn.offset).all(|(e, b)| (b - 0.1 * e).abs() < 1e-12));
        }
    }
}
