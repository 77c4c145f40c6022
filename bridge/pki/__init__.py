"""Who is who on the bus: certificates, one for each role, made here or brought along."""
