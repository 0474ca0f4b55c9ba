//! Health monitor: the cloud is spread where it no longer explains its soundings.

use super::TerrainCore;
use crate::event::seconds;
use crate::random::Purpose;

/// Where the noise was found to be larger than stated, the mean statistic of honest soundings is 1 still, while a wrong
/// place misfits alike for several soundings: it is noticed from here on, five standard deviations of the mean.
const LEAST_ALARM: f64 = 2.2;

impl<const K: usize> TerrainCore<K> {
    /// Health monitor; true after an alarm, when the cloud was spread.
    pub fn watch(&mut self, statistic: f64) -> bool {
        let (Some(monitor), Some(now_ns)) = (self.options.monitor, self.state.core.now_ns()) else {
            return false;
        };
        let beyond_one = (monitor.alarm - 1.0) / self.noise_factor().powi(2);
        let alarm = (1.0 + beyond_one).max(monitor.alarm.min(LEAST_ALARM));
        let state = &mut self.state;
        state.health += monitor.forgetting * (statistic.min(monitor.clip) - state.health);
        let since_s = state.last_alarm_ns.map_or(f64::INFINITY, |last| seconds(now_ns - last));
        if state.health <= alarm || since_s < monitor.quiet_s {
            return false;
        }
        state.noise.forget_last();
        if let Some(region) = state.region.clone() {
            state.health = 1.0;
            state.alarms += 1;
            state.last_alarm_ns = Some(now_ns);
            self.acquire_anew(region);
            return true;
        }
        let position_m = if since_s < monitor.repeat_s { monitor.repeat_spread_m } else { monitor.spread_m };
        let mut linear = [0.0; K];
        linear[..2].fill(monitor.spread_current_mps);
        let stream = state.core.next_stream(Purpose::Recovery);
        let cloud = &mut state.core.cloud;
        cloud.equalise();
        cloud.spread(position_m, linear, &stream);
        cloud.offset_variance.fill(self.options.sigma_offset0_m.powi(2));
        state.health = 1.0;
        state.alarms += 1;
        state.last_alarm_ns = Some(now_ns);
        true
    }
}
