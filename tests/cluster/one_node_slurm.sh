#!/usr/bin/env bash
# A Slurm cluster of this one machine, from Debian's packages, for `make test-slurm`. As root, on Debian 12 or 13; no systemd.
#
#   one_node_slurm.sh start DIR [--accounting]   install what is missing; start munged, slurmctld, slurmd (slurmdbd, MariaDB)
#   one_node_slurm.sh stop DIR                   end what `start` started, by the process numbers kept in DIR
#
# Configuration, state, logs and the database are all in DIR, with a link /etc/slurm/slurm.conf while it runs. Jobs are held
# to their memory by what they are seen to use (JobAcctGather), so that it needs no control groups. One node, this machine;
# partitions "main" (default), and "short" of at most 10 minutes.
set -euo pipefail

usage() { sed -n '2,9s/^# \?//p' "${BASH_SOURCE[0]}" >&2; exit 2; }
[ $# -ge 2 ] || usage
action=$1 place=$2 accounting=${3:-}
[ "$(id -u)" = 0 ] || { echo "error: $0: must be run as root: it starts Slurm's daemons" >&2; exit 2; }
mkdir -p "$place"
place=$(readlink -f "$place")
export SLURM_CONF=$place/slurm.conf
LINK=/etc/slurm/slurm.conf

packages() {
    local wanted=(slurm-wlm munge) missing=()
    [ -z "$accounting" ] || wanted+=(slurmdbd mariadb-server)
    for package in "${wanted[@]}"; do
        [ "$(dpkg-query -W -f='${db:Status-Status}' "$package" 2>/dev/null)" = installed ] || missing+=("$package")
    done
    [ ${#missing[@]} = 0 ] && return
    # Packages must not start daemons of their own.
    local rule=/usr/sbin/policy-rc.d made=
    [ -e $rule ] || { printf '#!/bin/sh\nexit 101\n' > $rule; chmod +x $rule; made=yes; }
    apt-get update -q >&2 || true
    DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends "${missing[@]}" >&2
    [ -z "$made" ] || rm -f $rule
}

wait_for() {  # wait_for WHAT COMMAND...: until the command succeeds, at most a minute
    local what=$1; shift
    for _ in $(seq 120); do "$@" > /dev/null 2>&1 && return; sleep 0.5; done
    echo "error: $what did not start within a minute; see the logs in $place" >&2
    exit 1
}

free_port() { python3 -c 'import socket; s = socket.socket(); s.bind(("", 0)); print(s.getsockname()[1])'; }

start_munge() {
    install -d -o munge -g munge -m 0755 /run/munge "$place/munge"
    pgrep -x munged > /dev/null && return  # one of this machine's own serves
    # munged trusts no path that others could write to: what is below DIR is root's or its own, DIR may be in /tmp
    su -s /bin/sh munge -c "munged --force --log-file='$place/munge/munged.log' --pid-file='$place/munge/munged.pid' \
        --seed-file='$place/munge/munged.seed'" >&2
    wait_for munged sh -c 'munge -n | unmunge'
}

start_database() {
    install -d -o mysql -g mysql -m 0755 "$place/database"
    mariadb-install-db --user=mysql --datadir="$place/database" --skip-test-db > "$place/mariadb-install.log" 2>&1
    mariadbd --user=mysql --datadir="$place/database" --socket="$place/database/socket" --skip-networking \
        --pid-file="$place/database/mariadbd.pid" --log-error="$place/database/mariadbd.log" \
        --innodb-buffer-pool-size=64M --innodb-lock-wait-timeout=900 > /dev/null 2>&1 &
    wait_for mariadbd mariadb-admin --socket="$place/database/socket" ping
    mariadb --socket="$place/database/socket" -e "CREATE DATABASE IF NOT EXISTS slurm_acct_db;
        CREATE USER IF NOT EXISTS 'slurm'@'localhost' IDENTIFIED BY 'slurm'; GRANT ALL ON slurm_acct_db.* TO 'slurm'@'localhost';"
    # libmariadb takes a path for the host's socket from the environment
    install -o root -g root -m 0600 /dev/null "$place/slurmdbd.conf"
    cat > "$place/slurmdbd.conf" <<END
AuthType=auth/munge
DbdHost=$(hostname -s)
DbdAddr=127.0.0.1
DbdPort=$1
SlurmUser=root
LogFile=$place/slurmdbd.log
PidFile=$place/slurmdbd.pid
StorageType=accounting_storage/mysql
StorageHost=localhost
StorageUser=slurm
StoragePass=slurm
StorageLoc=slurm_acct_db
END
    SLURM_CONF=$place/slurmdbd.conf MYSQL_UNIX_PORT=$place/database/socket slurmdbd
    wait_for slurmdbd sacctmgr -n show cluster
    sacctmgr -i add cluster one > /dev/null 2>&1 || true
    sacctmgr -i add account users > /dev/null 2>&1 || true
    sacctmgr -i add user "$(id -un)" account=users > /dev/null 2>&1 || true
}

write_configuration() {  # PORT_CTLD PORT_D PORT_DBD
    local memory
    memory=$(awk '/MemTotal/ { print int($2 / 1024 * 0.9) }' /proc/meminfo)
    cat > "$SLURM_CONF" <<END
ClusterName=one
SlurmctldHost=$(hostname -s)(127.0.0.1)
SlurmctldPort=$1
SlurmdPort=$2
SlurmUser=root
AuthType=auth/munge
CredType=cred/munge
StateSaveLocation=$place/state
SlurmdSpoolDir=$place/spool
SlurmctldPidFile=$place/slurmctld.pid
SlurmdPidFile=$place/slurmd.pid
SlurmctldLogFile=$place/slurmctld.log
SlurmdLogFile=$place/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
JobAcctGatherType=jobacct_gather/linux
JobAcctGatherFrequency=task=2
JobAcctGatherParams=OverMemoryKill,UsePss
OverTimeLimit=0
KillWait=5
MinJobAge=300
SchedulerParameters=sched_interval=5,batch_sched_delay=1
ReturnToService=2
$([ -z "$accounting" ] || echo "AccountingStorageType=accounting_storage/slurmdbd
AccountingStorageHost=127.0.0.1
AccountingStoragePort=$3")
NodeName=$(hostname -s) NodeAddr=127.0.0.1 CPUs=$(nproc) RealMemory=$memory State=UNKNOWN
PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP
PartitionName=short Nodes=ALL MaxTime=10 State=UP
END
}

start() {
    packages
    if [ -e $LINK ] && [ "$(readlink $LINK)" != "$SLURM_CONF" ]; then
        echo "error: $LINK: there is a Slurm on this machine already" >&2
        exit 2
    fi
    trap stop EXIT  # what a start that fails leaves
    ln -sfn "$SLURM_CONF" $LINK
    install -d -m 0755 "$place/state" "$place/spool"
    start_munge
    local dbd
    dbd=$(free_port)
    write_configuration "$(free_port)" "$(free_port)" "$dbd"
    [ -z "$accounting" ] || start_database "$dbd"
    slurmctld
    wait_for slurmctld scontrol ping
    slurmd
    wait_for "the node" sh -c 'sinfo -h -o %T | grep -q -x -E "idle|mixed|allocated"'
    trap - EXIT
    echo "Slurm $(sinfo --version | cut -d ' ' -f 2), $([ -z "$accounting" ] && echo without || echo with) accounting"
}

stop() {
    local file number
    scancel --user="$(id -un)" > /dev/null 2>&1 || true
    for file in slurmd.pid slurmctld.pid slurmdbd.pid database/mariadbd.pid munge/munged.pid; do
        [ -s "$place/$file" ] || continue
        number=$(cat "$place/$file")
        kill "$number" 2> /dev/null || continue
        for _ in $(seq 60); do kill -0 "$number" 2> /dev/null || break; sleep 0.5; done
        rm -f "$place/$file"
    done
    [ "$(readlink $LINK)" != "$SLURM_CONF" ] || rm -f $LINK
}

case $action in
    start) start ;;
    stop) stop ;;
    *) usage ;;
esac
