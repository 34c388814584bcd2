"""`inercal compile`: compile all kernels in advance."""

from inercal.basics.units import format_count
from inercal.cli.console import print_json, progress_status
from inercal.cli.options import Json


def run(json: Json = False) -> None:
    """Compile all kernels now, so that later runs need not wait for the compiler.

    The kernels are stored beside the installed modules, so that they also work in a read-only
    installation. If you cannot write to the installation, they are stored in your user cache. It
    takes about a minute.
    """
    from inercal.basics.kernel_cache import count_kernels
    from inercal.cli.kernel_compilation import compile_kernels

    with progress_status("compiling kernels") as update:
        failed = compile_kernels(lambda what: update(f"compiling kernels: {what}"))
    place, count = count_kernels()
    if json:
        print_json({"folder": place, "kernels": count, "not_compiled": list(failed)})
        return
    print(f"{format_count(count, 'kernel is', 'kernels are')} compiled, in {place}")
    for line in failed:
        print(f"not compiled: {line}")
