//! FIM.
