//! Random programs of everything a host, a robot and a bad line can do: whatever state they lead to, every output keeps the
//! configured limits, and playing to the end, or stopping, is a controlled stop. `examples/campaign.rs` runs many more.

mod common;

#[test]
fn two_thousand_random_programs_stay_within_limits_and_can_always_stop() {
    common::program::programs(0..2000);
}
