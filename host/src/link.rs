//! Sans-IO state machines, one per wire.
