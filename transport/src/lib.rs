//! Links for frame-synchronous data over pluggable transports.
