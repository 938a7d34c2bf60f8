/* The floor of wake-up latency: sleep to absolute times, note how late, nothing else. Prints nanoseconds. */
#define _GNU_SOURCE
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <time.h>

int main(int count, char **argument) {
    if (count != 3) return 2;
    long cycles = atol(argument[1]), period = atol(argument[2]);
    long *late = calloc((size_t)cycles, sizeof *late);
    if (late == NULL) return 1;
    struct sched_param fifo = {.sched_priority = 80};
    /* without the right to these the loop runs as it is, as the executor does */
    (void)!sched_setscheduler(0, SCHED_FIFO, &fifo);
    (void)!mlockall(MCL_CURRENT | MCL_FUTURE);
    struct timespec due, now;
    clock_gettime(CLOCK_MONOTONIC, &due);
    for (long cycle = 0; cycle < cycles; cycle++) {
        due.tv_nsec += period;
        while (due.tv_nsec >= 1000000000L) {
            due.tv_nsec -= 1000000000L;
            due.tv_sec++;
        }
        while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL) != 0) {
        }
        clock_gettime(CLOCK_MONOTONIC, &now);
        late[cycle] = (now.tv_sec - due.tv_sec) * 1000000000L + now.tv_nsec - due.tv_nsec;
    }
    for (long cycle = 0; cycle < cycles; cycle++) printf("%ld\n", late[cycle]);
    free(late);
    return 0;
}
