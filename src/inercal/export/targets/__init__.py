"""The export targets, with one module for each; `inercal.export.TARGETS` registers them."""
