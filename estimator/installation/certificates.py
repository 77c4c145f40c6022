"""Certificates of an installation: an authority, and for each machine a folder with its programs' certificates."""

from pathlib import Path

from bridge.bus import router_file
from bridge.pki.certificate_checks import certificates, hosts_of, lasts_of
from bridge.pki.folder import Folder, utc_now
from bridge.pki.member import Member, Role
from estimator.installation.owned_files import OwnedFiles
from estimator.installation.ward_text import ROUTER_PORT, Plan, bridge_machine

_ROUTER = Member(Role.ROUTER, "router-1")
#: programs on the server that show the router a certificate
_PROGRAMS = (
    Member(Role.BRIDGE, "bridge-1"),
    Member(Role.ESTIMATOR, "estimator-1"),
    Member(Role.COMMANDER, "page"),
    Member(Role.RECORDER, "recorder-1"),
)


def certify(plan: Plan, files: OwnedFiles) -> None:
    """Make missing certificates of a ward, renew those that expire soon, and copy new ones to the machines' folders.

    For each machine that runs only a bridge, a missing ward file is written, too. Raises ValueError if an existing
    certificate names other hosts than the plan.
    """
    authority, page = Folder(plan.authority), Member(Role.PAGE, plan.ward)
    bridges = [Member(Role.BRIDGE, name) for name in plan.bridges]
    here = {page: plan.hosts}
    if bridges:
        here[_ROUTER] = tuple(dict.fromkeys((*plan.hosts, "localhost", "127.0.0.1")))
        here |= dict.fromkeys(_PROGRAMS, ())
    if not (plan.authority / "ca.pem").exists():
        files.did("make", "made", f"the certificate authority in {plan.authority}/")
        if not files.dry:
            authority.make(f"truerate {plan.ward}", utc_now())
    for member, hosts in (here | dict.fromkeys(bridges, ())).items():
        _issue(authority, member, hosts, files)
    files.folder(plan.pki)
    for member in here:
        _copy(authority, member, plan.pki, files)
    if bridges:
        _router(plan, authority, [*_PROGRAMS, *bridges], files)
    for bridge in bridges:
        machine = plan.machine(bridge.name)
        files.folder(machine / "pki")
        _copy(authority, bridge, machine / "pki", files)
        if not (machine / "ward.toml").exists():
            files.write(machine / "ward.toml", bridge_machine(plan, bridge.name))


def _issue(authority: Folder, member: Member, hosts: tuple[str, ...], files: OwnedFiles) -> None:
    """Issue a certificate, or renew one that expires soon. Raises ValueError if there is one that names other hosts."""
    files_of = authority.identity(authority.current(member))
    if Path(files_of.certificate).exists():
        there = certificates(files_of.certificate)[0]
        if lacks := set(hosts) - set(hosts_of(there)):
            raise ValueError(
                f"{files_of.certificate} does not name {', '.join(sorted(lacks))}: remove it and {files_of.key}, then run"
                " this command again"
            )
        if utc_now() >= lasts_of(there).soon:
            files.did("renew", "renewed", f"the certificate of {member.label}")
            if not files.dry:
                authority.renew(member, utc_now())
        return
    files.did("issue", "issued", f"a certificate for {member.label}")
    if not files.dry:
        authority.issue(member, utc_now(), hosts=hosts)


def _copy(authority: Folder, member: Member, to: Path, files: OwnedFiles) -> None:
    """Copy a program's certificate, its key and the authority's certificate to its machine's folder."""
    if files.dry and not (authority.path / "ca.pem").exists():
        return
    one = authority.identity(authority.current(member))
    for path in map(Path, (one.ca, one.certificate)):
        if path.exists():
            files.write(to / path.name, path.read_text("ascii"))
    if (key := Path(one.key)).exists():
        files.write(to / key.name, key.read_text("ascii"), secret=True)


def _router(plan: Plan, authority: Folder, members: list[Member], files: OwnedFiles) -> None:
    """Write the router's file, with the rules for all programs of the ward, and the issuers that it accepts."""
    router, current = authority.current(_ROUTER), [authority.current(member) for member in members]
    gate = Folder(plan.pki).gate(router)
    if not files.dry:
        authority.admit(router, current)
        files.write(Path(gate.ca), Path(authority.gate(router).ca).read_text("ascii"))
    settings = router_file.guarded([f"tls/0.0.0.0:{ROUTER_PORT}"], gate, [(plan.ward, member) for member in current])
    title = f"Router of {plan.ward}.\nWritten by `truerate init`: do not edit; run it again instead."
    files.write(plan.folder / "router.json5", router_file.rendered(settings, title))
