"""Installation of a ward on a machine, `truerate init`: ward file, certificates, people.

Start reading at `ward.install`.
"""
