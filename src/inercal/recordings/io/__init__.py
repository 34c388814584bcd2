"""Files in and out: tables of any common format, recordings, and their audit."""
