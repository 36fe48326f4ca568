//! Simulated peers on the real wires.
