# Sourced by scripts/run, scripts/test and scripts/in_environment: makes .venv and installs the checkout into it, once.
#
#   prepare_environment EXTRAS      EXTRAS: "" or those of pyproject.toml, such as "[dev]"; sets $python
#
# Nothing is installed twice: a stamp in .venv holds a hash of pyproject.toml, the interpreter and the checkout's path.
# An environment with "[dev]" also serves "" and "[opencl]".
# AEROKERNELS_PYTHON names the interpreter to make .venv with.

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
python=$root/.venv/bin/python

say() { printf '%s\n' "$*" >&2; }

find_python() {
    local name
    for name in ${AEROKERNELS_PYTHON:-python3 python3.13 python3.12 python3.11}; do
        if "$name" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2])' </dev/null >/dev/null 2>&1; then
            printf '%s\n' "$name"
            return
        fi
    done
    say "error: no Python 3.11 or newer found (tried: ${AEROKERNELS_PYTHON:-python3 python3.13 python3.12 python3.11}); install one, or name it in AEROKERNELS_PYTHON"
    return 1
}

environment_key() {
    "$python" - "$root" <<'PY'
import hashlib, pathlib, sys
root = pathlib.Path(sys.argv[1])
key = [str(root), sys.version, (root / "pyproject.toml").read_text(encoding="utf-8")]
print(hashlib.sha256("\0".join(key).encode()).hexdigest())
PY
}

prepare_environment() {
    local extras=$1 stamp key base
    stamp=$root/.venv/.aerokernels-installed
    if [ -x "$python" ] && key=$(environment_key); then
        if [ -f "$stamp$extras" ] && [ "$(cat "$stamp$extras")" = "$key" ]; then return; fi
        if { [ -z "$extras" ] || [ "$extras" = "[opencl]" ]; } && [ -f "$stamp[dev]" ] && [ "$(cat "$stamp[dev]")" = "$key" ]; then return; fi
    fi
    local installer=("$python" -m pip) packages=()
    # An incomplete .venv has no pip yet; making it again completes it.
    if ! { [ -x "$python" ] && "$python" -m pip --version </dev/null >/dev/null 2>&1; }; then
        base=$(find_python)
        say "making $root/.venv"
        # The interpreter's own pip installs .venv's with the other packages: venv would take several seconds for it.
        if "$base" -m venv --without-pip "$root/.venv" </dev/null >/dev/null 2>&1 \
            && "$base" -m pip --python "$python" --version </dev/null >/dev/null 2>&1; then
            installer=("$base" -m pip --python "$python") packages=(pip)
        elif ! "$base" -m venv "$root/.venv" </dev/null >&2; then
            say "error: $base cannot make a virtual environment; on Debian and Ubuntu: apt install python3-venv"
            return 1
        fi
    fi
    say "installing aerokernels$extras into $root/.venv (once; a few minutes on a slow line)"
    # Python compiles a module when it is first imported; compiling all modules here would double the time.
    packages+=(--editable "$root$extras")
    if ! "${installer[@]}" install --quiet --no-compile --disable-pip-version-check --no-input "${packages[@]}" </dev/null >&2; then
        say "error: pip could not install $root$extras; its messages are above"
        return 1
    fi
    key=$(environment_key)
    printf '%s\n' "$key" > "$stamp$extras"
}

# Without stored bytecode each process takes a second or two to compile its imports. If Python is not to write bytecode
# into the checkout, it is stored in .venv instead.
keep_bytecode() {
    if [ -n "${PYTHONDONTWRITEBYTECODE:-}" ]; then
        unset PYTHONDONTWRITEBYTECODE
        export PYTHONPYCACHEPREFIX=${PYTHONPYCACHEPREFIX:-$root/.venv/bytecode}
    fi
}
