//! The capture station as a library: its stages, its sources, its recordings and its service.
