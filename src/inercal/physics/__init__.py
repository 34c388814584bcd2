"""The sensor model, frames, the earth, motion and plans."""
