//! Tests of reports about recordings that are written here.
