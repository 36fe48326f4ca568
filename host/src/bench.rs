//! Published experiments done again, and what the control law comes to.

pub mod base;
pub mod fig6;
pub mod servoj;
