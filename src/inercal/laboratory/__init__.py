"""A laboratory: register, certificates, control charts and repeated sessions."""
