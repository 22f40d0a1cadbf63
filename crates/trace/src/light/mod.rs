//! Lights: what the user states, and how they are sampled.
