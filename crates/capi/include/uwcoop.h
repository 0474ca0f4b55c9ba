/* The navigators of uwcoop for C and C++. Made by `cbindgen --config crates/capi/cbindgen.toml crates/capi`: do not edit. */

#ifndef UWCOOP_H
#define UWCOOP_H

#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

// What a call came to.
enum uwcoop_code
#ifdef __cplusplus
  : int32_t
#endif // __cplusplus
 {
  // It worked.
  UWCOOP_OK = 0,
  // A null pointer, a text that is not UTF-8, an unknown kind, a wrong number of values.
  UWCOOP_BAD_ARGUMENT = 1,
  // The navigator refused it; its state is as it was.
  UWCOOP_REFUSED = 2,
  // The buffer is too small; the length that is needed was written.
  UWCOOP_BUFFER_TOO_SMALL = 3,
  // A defect of the library: the navigator is to be destroyed.
  UWCOOP_INTERNAL = 4,
};
#ifndef __cplusplus
typedef int32_t uwcoop_code;
#endif // __cplusplus

// What a sensor says, and its values in their order. World frame: local east–north, m; body frame: forward–left; angles
// rad, yaw counter-clockwise from east; sigmas are standard deviations.
enum uwcoop_kind
#ifdef __cplusplus
  : int32_t
#endif // __cplusplus
 {
  // Commanded velocity through the water: east, north, m/s.
  UWCOOP_MOTION = 0,
  // Since the last one: forward m, left m, yaw rad; covariance ff, fl, fy, ll, ly, yy.
  UWCOOP_ODOMETRY = 1,
  // Surface to seabed: m, sigma m.
  UWCOOP_WATER_DEPTH = 2,
  // Own depth: m, sigma m.
  UWCOOP_DEPTH = 3,
  // Yaw: rad, sigma rad.
  UWCOOP_HEADING = 4,
  // Yaw rate: rad/s, sigma rad/s.
  UWCOOP_TURN_RATE = 5,
  // Over ground: forward, left, sigma, m/s.
  UWCOOP_GROUND_VELOCITY = 6,
  // Position: east m, north m; covariance ee, en, nn, m².
  UWCOOP_FIX = 7,
  // The vehicle stands on the seabed: no values.
  UWCOOP_LANDED = 8,
  // It no longer does: no values.
  UWCOOP_LIFTED_OFF = 9,
  // It took a role: 1, the landmark's; 0, the mover's.
  UWCOOP_ROLE_TAKEN = 10,
  // Through the water: forward, left, sigma, m/s.
  UWCOOP_WATER_VELOCITY = 11,
};
#ifndef __cplusplus
typedef int32_t uwcoop_kind;
#endif // __cplusplus

// What became of an event.
enum uwcoop_outcome
#ifdef __cplusplus
  : int32_t
#endif // __cplusplus
 {
  // It changed the estimate.
  UWCOOP_FUSED = 0,
  // It only advanced the time, or this navigator does not use it.
  UWCOOP_NOTED = 1,
  // It contradicts the belief; counted, the estimate is as it was.
  UWCOOP_GATED = 2,
  // A packet that does not decode, is a copy, or is too old; counted, the estimate is as it was.
  UWCOOP_REJECTED = 3,
};
#ifndef __cplusplus
typedef int32_t uwcoop_outcome;
#endif // __cplusplus

// Whether a vehicle has started, and whether it is over its chart.
enum uwcoop_status
#ifdef __cplusplus
  : int32_t
#endif // __cplusplus
 {
  // No position fix yet: the mean is NaN, the covariance infinite.
  UWCOOP_NOT_STARTED = 0,
  // Navigating normally.
  UWCOOP_NAVIGATING = 1,
  // Off the chart or over a hole: dead reckoning until the chart is back.
  UWCOOP_OFF_CHART = 2,
  // The whole region where the vehicle may be is searched.
  UWCOOP_ACQUIRING = 3,
};
#ifndef __cplusplus
typedef int32_t uwcoop_status;
#endif // __cplusplus

// One vehicle's navigator.
typedef struct uwcoop_navigator uwcoop_navigator;

// A depth grid: float32, row by row from the south-west corner, positive down, NaN for holes. It is copied.
typedef struct {
  // rows · cols depths, m.
  const float *depth_m;
  // Rows, from south to north.
  size_t rows;
  // Columns, from west to east.
  size_t cols;
  // East of the first node, m.
  double east0_m;
  // North of the first node, m.
  double north0_m;
  // Distance between nodes, m.
  double cell_m;
  // Standard deviation of the chart's error, m.
  double sigma_map_m;
  // Length over which the error is correlated, m.
  double correlation_length_m;
} uwcoop_chart;

// Belief of the vehicle about its own position.
typedef struct {
  // Time it holds for, ns since the mission's epoch.
  int64_t t_ns;
  // East and north, m.
  double mean_m[2];
  // East-east, east-north, north-north, m².
  double covariance_m2[3];
  // Counter-clockwise from east, rad; NaN where it is not estimated.
  double yaw_rad;
  // Effective sample size; NaN for navigators without particles.
  double ess;
  // Measurements gated and packets rejected so far.
  uint64_t rejected;
  // Whether the chart helps now.
  uwcoop_status status;
} uwcoop_estimate;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Text of the last failure in this thread; never null, valid until the next call in this thread.
const char *uwcoop_last_error(void);

// Make the navigator of one vehicle of a team.
//
// `name`: e.g. "team". `options_json`: the options that are stated, as in a scenario's table `[navigator.NAME]`, e.g.
// "{\"particles\": 1500}"; null: the defaults. `chart`: null: no chart on board. All vehicles of a team take the same
// `vehicles`, `sound_speed_mps` and options. `created` is written on success; `uwcoop_destroy` ends it.
//
// Texts end in 0; `created` must be valid for writing.
uwcoop_code uwcoop_create(const char *name,
                          uint16_t vehicle,
                          size_t vehicles,
                          double sound_speed_mps,
                          uint64_t seed,
                          const char *options_json,
                          const uwcoop_chart *chart,
                          uwcoop_navigator **created);

// End a navigator; null is nothing.
void uwcoop_destroy(uwcoop_navigator *navigator);

// Tag the packets of this navigator and check those of the others; once, before the first event.
//
// `key`: the team's, 16 to 64 bytes. `tag_bytes`: 1 to 16. `mission`: another number for each mission with this key.
uwcoop_code uwcoop_authenticate(uwcoop_navigator *navigator,
                                const uint8_t *key,
                                size_t key_bytes,
                                size_t tag_bytes,
                                uint64_t mission);

// The packet for the slot at `tol_ns`.
//
// `packet` is a buffer of `capacity_bytes`, what the slot holds; `packet_bytes` is written: 0 is silence.
uwcoop_code uwcoop_transmit(uwcoop_navigator *navigator,
                            int64_t tol_ns,
                            uint8_t *packet,
                            size_t capacity_bytes,
                            size_t *packet_bytes);

// The belief predicted to `t_ns`; changes nothing.
uwcoop_code uwcoop_get_estimate(uwcoop_navigator *navigator,
                                int64_t t_ns,
                                uwcoop_estimate *estimate);

// Everything that determines what comes next, counters against replayed packets included; never the key.
//
// `state` is a buffer of `capacity_bytes`, or null to learn the length; `state_bytes` is written in both cases.
uwcoop_code uwcoop_snapshot(uwcoop_navigator *navigator,
                            uint8_t *state,
                            size_t capacity_bytes,
                            size_t *state_bytes);

// Take up a snapshot of a navigator that was made the same.
uwcoop_code uwcoop_restore(uwcoop_navigator *navigator, const uint8_t *state, size_t state_bytes);

// Hand over what a sensor said at `t_ns`, a `kind` of `uwcoop_kind`, with its `count` values. Events come in the order of time.
//
// `outcome` may be null.
uwcoop_code uwcoop_handle(uwcoop_navigator *navigator,
                          int64_t t_ns,
                          int32_t kind,
                          const double *values,
                          size_t count,
                          uwcoop_outcome *outcome);

// Hand over a mutual positioning with `peer` that ended at `t_ns` and began at `transmit_ns`: slant range, direction to the
// peer in the own body frame, direction to this vehicle in the peer's, the peer's depth. NaN is what was not measured.
//
// `outcome` may be null.
uwcoop_code uwcoop_acoustic_fix(uwcoop_navigator *navigator,
                                int64_t t_ns,
                                uint16_t peer,
                                int64_t transmit_ns,
                                double range_m,
                                double own_bearing_rad,
                                double peer_bearing_rad,
                                double peer_depth_m,
                                uwcoop_outcome *outcome);

// Hand over, at `t_ns`, a range to a beacon at a known place: the signal arrived at `measured_ns`; slant range and its sigma,
// m; `one_way` is 1 for a travel time one way, in which the difference of the clocks stands, 0 for one there and back.
//
// `outcome` may be null.
uwcoop_code uwcoop_beacon_range(uwcoop_navigator *navigator,
                                int64_t t_ns,
                                int64_t measured_ns,
                                double beacon_e_m,
                                double beacon_n_m,
                                double beacon_depth_m,
                                double range_m,
                                double sigma_m,
                                int32_t one_way,
                                uwcoop_outcome *outcome);

// Hand over, at `t_ns`, a position by an ultra-short baseline that was measured at `measured_ns`: east, north, m; covariance,
// m².
//
// `outcome` may be null.
uwcoop_code uwcoop_usbl(uwcoop_navigator *navigator,
                        int64_t t_ns,
                        int64_t measured_ns,
                        double east_m,
                        double north_m,
                        double cov_ee_m2,
                        double cov_en_m2,
                        double cov_nn_m2,
                        uwcoop_outcome *outcome);

// Hand over a packet: `t_ns` when decoding ended, `tol_ns` launch, `toa_ns` arrival of the signal's start.
//
// `outcome` may be null.
uwcoop_code uwcoop_receive(uwcoop_navigator *navigator,
                           int64_t t_ns,
                           uint16_t sender,
                           int64_t tol_ns,
                           int64_t toa_ns,
                           const uint8_t *packet,
                           size_t packet_bytes,
                           uwcoop_outcome *outcome);

#ifdef __cplusplus
} // extern "C"
#endif // __cplusplus

#endif /* UWCOOP_H */
