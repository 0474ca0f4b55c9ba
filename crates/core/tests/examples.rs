//! The examples do what they say.
#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

#[allow(dead_code, reason = "its `main` prints; the test calls what `main` calls")]
#[path = "../examples/vehicle_computer.rs"]
mod vehicle_computer;

#[test]
fn the_vehicle_computer_finds_its_place_and_sends_packets() {
    let (estimate, sent_bytes) = vehicle_computer::dive().unwrap();
    let off_m = (estimate.mean_m[0] - 410.0).hypot(estimate.mean_m[1] - 348.0);
    let [ee, _, nn] = estimate.covariance_m2;
    assert!(off_m < 10.0, "{off_m} m off; dead reckoning would be 48 m off");
    assert!(
        ee > 0.0 && nn > 0.0 && off_m < 4.0 * (ee + nn).sqrt(),
        "{off_m} m off, covariance {ee}, {nn} m²"
    );
    assert!(sent_bytes > 100, "{sent_bytes} bytes");
}
