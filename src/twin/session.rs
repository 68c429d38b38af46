//! Recordings as sessions: each link's measured input and output, cut into runs.
