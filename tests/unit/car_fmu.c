/* The car of the study, and ways to misbehave, as an FMU of FMI 2.0, or of FMI 3.0 where FMI3 is defined. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

enum { RANGE, RANGE_RATE, HOST_SPEED, ACCELERATION, TROUBLE, KMH, COUNT };

typedef struct {
    double value[COUNT];
    double command, error, timer, onset;
} Car;

static double limited(double x, double low, double high) { return x < low ? low : x > high ? high : x; }

static int step(Car *car, double time, double h) {
    double range = car->value[RANGE], speed = car->value[HOST_SPEED];
    int trouble = time > 0.35 ? (int)car->value[TROUBLE] : 0;
    if (car->value[KMH]) speed /= 3.6;
    if (trouble == 1) for (;;) sleep(1);
    if (trouble == 2) abort();
    if (trouble == 3) return 1;
    if (trouble == 5) for (int i = 0; i < 2000; i++) printf("a line that nobody asked for\n");
    double ttc = -range / car->value[RANGE_RATE];
    double low = 16 / 3.6, threshold = 0.86 + (0.91 - 0.86) / (40 / 3.6 - low) * (speed - low);
    if (threshold > 0.91) threshold = 0.91;
    int was_on = car->timer > 0, on = ttc > 0 && (ttc <= threshold || (was_on && ttc <= 1.0));
    if (!was_on) car->onset = car->command;
    car->timer = on ? car->timer + h : 0;
    double error = 2.0 - range / speed;
    double acc = car->command - 38.6252446973784 * (error - car->error)
                 + -1.35416845633818 * h / 2 * (error + car->error);
    acc = limited(acc, -5, speed >= 90 / 2.236 ? 0 : 5);
    car->command = on ? fmax(car->onset - 16 * car->timer, -10) : acc;
    car->error = on ? 0 : error;
    double last = car->value[ACCELERATION];
    car->value[ACCELERATION] = limited(limited(car->command, -9.8, 9.8), last - 20 * h, last + 20 * h);
    if (trouble == 4) car->value[ACCELERATION] = NAN;
    return 0;
}

#ifdef FMI3
#include "fmi3Functions.h"
fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String path, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference required[], size_t count,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
    return calloc(1, sizeof(Car));
}
void fmi3FreeInstance(fmi3Instance car) { free(car); }
fmi3Status fmi3EnterInitializationMode(
    fmi3Instance car, fmi3Boolean given, fmi3Float64 tolerance, fmi3Float64 start, fmi3Boolean ends,
    fmi3Float64 stop) { return fmi3OK; }
fmi3Status fmi3ExitInitializationMode(fmi3Instance car) { return fmi3OK; }
fmi3Status fmi3Terminate(fmi3Instance car) { return fmi3OK; }
fmi3Status fmi3SetFloat64(
    fmi3Instance car, const fmi3ValueReference r[], size_t n, const fmi3Float64 values[], size_t m) {
    for (size_t i = 0; i < n; i++) ((Car *)car)->value[r[i]] = values[i];
    return fmi3OK;
}
fmi3Status fmi3GetFloat64(
    fmi3Instance car, const fmi3ValueReference r[], size_t n, fmi3Float64 values[], size_t m) {
    for (size_t i = 0; i < n; i++) values[i] = ((Car *)car)->value[r[i]];
    return fmi3OK;
}
fmi3Status fmi3DoStep(
    fmi3Instance car, fmi3Float64 time, fmi3Float64 h, fmi3Boolean keeps, fmi3Boolean *event,
    fmi3Boolean *ended, fmi3Boolean *early, fmi3Float64 *reached) {
    *event = *early = 0;
    *ended = time > 0.35 && ((Car *)car)->value[TROUBLE] == 6;
    *reached = time + h;
    return step(car, time, h) ? fmi3Error : fmi3OK;
}
#else
#include "fmi2Functions.h"
fmi2Component fmi2Instantiate(
    fmi2String name, fmi2Type type, fmi2String guid, fmi2String path, const fmi2CallbackFunctions *callbacks,
    fmi2Boolean visible, fmi2Boolean logging) { return calloc(1, sizeof(Car)); }
void fmi2FreeInstance(fmi2Component car) { free(car); }
fmi2Status fmi2SetupExperiment(
    fmi2Component car, fmi2Boolean given, fmi2Real tolerance, fmi2Real start, fmi2Boolean ends,
    fmi2Real stop) { return fmi2OK; }
fmi2Status fmi2EnterInitializationMode(fmi2Component car) { return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component car) { return fmi2OK; }
fmi2Status fmi2Terminate(fmi2Component car) { return fmi2OK; }
fmi2Status fmi2SetReal(fmi2Component car, const fmi2ValueReference r[], size_t n, const fmi2Real values[]) {
    for (size_t i = 0; i < n; i++) ((Car *)car)->value[r[i]] = values[i];
    return fmi2OK;
}
fmi2Status fmi2GetReal(fmi2Component car, const fmi2ValueReference r[], size_t n, fmi2Real values[]) {
    for (size_t i = 0; i < n; i++) values[i] = ((Car *)car)->value[r[i]];
    return fmi2OK;
}
fmi2Status fmi2DoStep(fmi2Component car, fmi2Real time, fmi2Real h, fmi2Boolean keeps) {
    return step(car, time, h) ? fmi2Error : fmi2OK;
}
#endif
