"""Installs a ward on a machine, `truerate init`: ward file, certificates, people. Begin at `ward.install`."""
