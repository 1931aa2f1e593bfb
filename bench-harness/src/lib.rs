//! The benchmark harness of esvo: matrix, timing, error, tables.
