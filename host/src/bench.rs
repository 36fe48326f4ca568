//! Published experiments done again.

pub mod fig6;
