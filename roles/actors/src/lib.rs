//! The three roles as state machines, their drivers, and the session that joins them.
