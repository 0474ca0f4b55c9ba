/* Two vehicles at sea by the C interface: events in, packets across, snapshot and restore, errors with text. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "uwcoop.h"

#define SECOND_NS INT64_C(1000000000)
#define CHECK(call)                                                                                                    \
    do {                                                                                                               \
        uwcoop_code code = (call);                                                                                     \
        if (code != UWCOOP_OK) {                                                                                       \
            fprintf(stderr, "%s: code %d: %s\n", #call, (int)code, uwcoop_last_error());                               \
            return 1;                                                                                                  \
        }                                                                                                              \
    } while (0)

enum { ROWS = 120, COLS = 120, CAPACITY = 32 };

static double water_depth_m(double east_m, double north_m) {
    return 20.0 + 3.0 * sin(east_m / 31.0) + 2.0 * cos(north_m / 23.0);
}

static uwcoop_navigator *make(uint16_t vehicle, const uwcoop_chart *chart) {
    static const uint8_t key[16] = "sixteen octets.";
    uwcoop_navigator *made = NULL;
    if (uwcoop_create("team", vehicle, 2, 1500.0, 1, "{\"particles\": 500}", chart, &made) != UWCOOP_OK) return NULL;
    if (uwcoop_authenticate(made, key, sizeof key, 4, 7) != UWCOOP_OK) return NULL;
    return made;
}

static int step(uwcoop_navigator *navigator, int vehicle, int t_s, double *east_m, double *north_m) {
    *east_m = 50.0 + 1.5 * t_s;
    *north_m = 300.0 - 120.0 * vehicle + 0.2 * t_s;
    if (t_s == 0) {
        double fix[5] = {*east_m, *north_m, 9.0, 0.0, 9.0};
        CHECK(uwcoop_handle(navigator, 0, UWCOOP_FIX, fix, 5, NULL));
    }
    double motion[2] = {1.5, 0.0}, sounding[2] = {water_depth_m(*east_m, *north_m), 0.1};
    CHECK(uwcoop_handle(navigator, t_s * SECOND_NS, UWCOOP_MOTION, motion, 2, NULL));
    CHECK(uwcoop_handle(navigator, t_s * SECOND_NS, UWCOOP_WATER_DEPTH, sounding, 2, NULL));
    return 0;
}

/* Stations that stand: a baseline whose positions come late, and ranges to a beacon; a log of speed through the water. */
static int stations(void) {
    uwcoop_navigator *mover = NULL;
    int fused = 0;
    CHECK(uwcoop_create("mpf", 0, 2, 1500.0, 7, NULL, NULL, &mover));
    double fix[5] = {0.0, 0.0, 4.0, 0.0, 4.0}, heading[2] = {0.0, 0.02}, depth[2] = {10.0, 0.1}, log_mps[3] = {1.0, 0.0, 0.05};
    CHECK(uwcoop_handle(mover, 0, UWCOOP_FIX, fix, 5, NULL));
    for (int64_t t_s = 0; t_s < 20; t_s++) {
        CHECK(uwcoop_handle(mover, t_s * SECOND_NS, UWCOOP_HEADING, heading, 2, NULL));
        CHECK(uwcoop_handle(mover, t_s * SECOND_NS, UWCOOP_DEPTH, depth, 2, NULL));
        CHECK(uwcoop_handle(mover, t_s * SECOND_NS, UWCOOP_WATER_VELOCITY, log_mps, 3, NULL));
    }
    uwcoop_outcome outcome;
    CHECK(uwcoop_usbl(mover, 20 * SECOND_NS, 18 * SECOND_NS, 18.0, 0.0, 1.0, 0.0, 1.0, &outcome));
    fused += outcome == UWCOOP_FUSED;
    CHECK(uwcoop_beacon_range(mover, 20 * SECOND_NS, 20 * SECOND_NS, 120.0, 0.0, 10.0, 100.0, 1.0, 0, &outcome));
    fused += outcome == UWCOOP_FUSED;
    if (uwcoop_beacon_range(mover, 20 * SECOND_NS, 20 * SECOND_NS, 120.0, 0.0, 10.0, 100.0, 1.0, 2, NULL) != UWCOOP_BAD_ARGUMENT) return 9;
    uwcoop_estimate belief;
    CHECK(uwcoop_get_estimate(mover, 20 * SECOND_NS, &belief));
    printf("stations: %d fused, %.1f m east\n", fused, belief.mean_m[0]);
    uwcoop_destroy(mover);
    return 0;
}

/* A vehicle that stands on the seabed is the landmark of one that moves: landing, roles, mutual positioning. */
static int landmark_pair(void) {
    uwcoop_navigator *pair[2] = {NULL, NULL};
    int fused = 0;
    for (int v = 0; v < 2; v++) {
        CHECK(uwcoop_create("landmark", (uint16_t)v, 2, 1500.0, 7, NULL, NULL, &pair[v]));
        double fix[5] = {100.0 * v, 0.0, 1.0, 0.0, 1.0}, heading[2] = {0.0, 0.02}, role[1] = {v == 0}, depth[2] = {10.0, 0.1};
        CHECK(uwcoop_handle(pair[v], 0, UWCOOP_FIX, fix, 5, NULL));
        CHECK(uwcoop_handle(pair[v], 0, UWCOOP_HEADING, heading, 2, NULL));
        CHECK(uwcoop_handle(pair[v], 0, UWCOOP_DEPTH, depth, 2, NULL));
        if (v == 0) CHECK(uwcoop_handle(pair[v], 0, UWCOOP_LANDED, NULL, 0, NULL));
        CHECK(uwcoop_handle(pair[v], 0, UWCOOP_ROLE_TAKEN, role, 1, NULL));
    }
    uint8_t packet[CAPACITY];
    size_t length = 0;
    CHECK(uwcoop_transmit(pair[0], SECOND_NS, packet, CAPACITY, &length));
    if (length) CHECK(uwcoop_receive(pair[1], 2 * SECOND_NS, 0, SECOND_NS, 1066666667, packet, length, NULL));
    double velocity[3] = {0.0, 0.0, 0.05};
    CHECK(uwcoop_handle(pair[1], 3 * SECOND_NS, UWCOOP_GROUND_VELOCITY, velocity, 3, NULL));
    uwcoop_outcome outcome;
    CHECK(uwcoop_acoustic_fix(pair[1], 4 * SECOND_NS, 0, 4 * SECOND_NS - 140000000, 100.0, 3.14, 0.0, 10.0, &outcome));
    fused += outcome == UWCOOP_FUSED;
    printf("landmark pair: mover fused %d positionings\n", fused);
    double wrong = 2.0;
    if (uwcoop_handle(pair[1], 5 * SECOND_NS, UWCOOP_ROLE_TAKEN, &wrong, 1, NULL) != UWCOOP_BAD_ARGUMENT) return 8;
    printf("bad argument: %s\n", uwcoop_last_error());
    CHECK(uwcoop_handle(pair[0], 5 * SECOND_NS, UWCOOP_LIFTED_OFF, NULL, 0, NULL));
    uwcoop_destroy(pair[0]);
    uwcoop_destroy(pair[1]);
    return 0;
}

int main(void) {
    static float depth_m[ROWS * COLS];
    for (int k = 0; k < ROWS * COLS; k++) depth_m[k] = (float)water_depth_m(k % COLS * 5.0, k / COLS * 5.0);
    uwcoop_chart chart = {depth_m, ROWS, COLS, 0.0, 0.0, 5.0, 0.1, 10.0};
    uwcoop_navigator *team[2] = {make(0, &chart), make(1, &chart)};
    if (!team[0] || !team[1]) {
        fprintf(stderr, "%s\n", uwcoop_last_error());
        return 1;
    }
    double east_m[2], north_m[2];
    int fused = 0, replayed_rejected = 0;
    for (int t_s = 0; t_s < 240; t_s++) {
        for (int v = 0; v < 2; v++)
            if (step(team[v], v, t_s, &east_m[v], &north_m[v])) return 1;
        if (t_s % 10 == 5) {
            int from = t_s / 10 % 2;
            uint8_t packet[CAPACITY];
            size_t length = 0;
            int64_t tol_ns = t_s * SECOND_NS;
            CHECK(uwcoop_transmit(team[from], tol_ns, packet, CAPACITY, &length));
            double range_m = hypot(east_m[0] - east_m[1], north_m[0] - north_m[1]);
            int64_t toa_ns = tol_ns + (int64_t)(range_m / 1500.0 * 1e9);
            uwcoop_outcome outcome;
            CHECK(uwcoop_receive(team[1 - from], toa_ns, (uint16_t)from, tol_ns, toa_ns, packet, length, &outcome));
            fused += outcome == UWCOOP_FUSED;
            CHECK(uwcoop_receive(team[1 - from], toa_ns, (uint16_t)from, tol_ns, toa_ns, packet, length, &outcome));
            replayed_rejected += outcome == UWCOOP_REJECTED;
        }
        if (t_s == 120) { /* vehicle 0's computer restarts */
            size_t length = 0;
            CHECK(uwcoop_snapshot(team[0], NULL, 0, &length));
            uint8_t *state = malloc(length);
            if (uwcoop_snapshot(team[0], state, length - 1, &length) != UWCOOP_BUFFER_TOO_SMALL) return 2;
            CHECK(uwcoop_snapshot(team[0], state, length, &length));
            uwcoop_destroy(team[0]);
            team[0] = make(0, &chart);
            CHECK(uwcoop_restore(team[0], state, length));
            if (uwcoop_restore(team[0], state, length / 2) != UWCOOP_REFUSED) return 3;
            free(state);
        }
    }
    for (int v = 0; v < 2; v++) {
        uwcoop_estimate belief;
        CHECK(uwcoop_get_estimate(team[v], 239 * SECOND_NS, &belief));
        printf("vehicle %d: %.17g %.17g, %.3f m off, status %d\n", v, belief.mean_m[0], belief.mean_m[1],
               hypot(belief.mean_m[0] - east_m[v], belief.mean_m[1] - north_m[v]), (int)belief.status);
    }
    printf("%d packets fused, %d replayed ones rejected\n", fused, replayed_rejected);
    /* What a caller gets wrong has a code and a text. */
    double nan_depth[2] = {NAN, 0.1};
    if (uwcoop_handle(team[0], 240 * SECOND_NS, UWCOOP_WATER_DEPTH, nan_depth, 2, NULL) != UWCOOP_REFUSED) return 4;
    printf("refused: %s\n", uwcoop_last_error());
    if (uwcoop_handle(team[0], 240 * SECOND_NS, 99, nan_depth, 2, NULL) != UWCOOP_BAD_ARGUMENT) return 5;
    printf("bad argument: %s\n", uwcoop_last_error());
    if (uwcoop_handle(NULL, 0, UWCOOP_MOTION, nan_depth, 2, NULL) != UWCOOP_BAD_ARGUMENT) return 6;
    uwcoop_navigator *none = NULL;
    if (uwcoop_create("teem", 0, 2, 1500.0, 1, NULL, NULL, &none) != UWCOOP_REFUSED || none) return 7;
    printf("unknown: %.60s\n", uwcoop_last_error());
    uwcoop_destroy(team[0]);
    uwcoop_destroy(team[1]);
    uwcoop_destroy(NULL);
    const int failed = landmark_pair();
    return failed ? failed : stations();
}
