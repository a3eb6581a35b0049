/* How far one picture is from another. */
#include "metrics.h"

#include <math.h>
#include <stdlib.h>

/* Share of the truth's mean that is shown in full colour. */
#define PICTURE_RANGE 0.25

typedef enum Verdict { OUTSIDE, MISMATCHED, NONFINITE, COUNTS } Verdict;

static bool shows_surface(const ChiaroIoImage *image, size_t pixel)
{
    return image->channels < 4 || image->pixels[pixel * image->channels + 3] > 0;
}

static Verdict judge(const ChiaroIoImage *test, const ChiaroIoImage *truth, const ChiaroIoImage *mask, size_t pixel)
{
    if (mask && !(mask->pixels[pixel * mask->channels] > 0.5f))
        return OUTSIDE;
    bool in_test = shows_surface(test, pixel), in_truth = shows_surface(truth, pixel);
    if (in_test != in_truth)
        return MISMATCHED;
    if (!in_test)
        return OUTSIDE;
    for (uint32_t c = 0; c < 3; c++) {
        float a = test->pixels[pixel * test->channels + c], b = truth->pixels[pixel * truth->channels + c];
        if (!isfinite(a) || !isfinite(b))
            return NONFINITE;
    }
    return COUNTS;
}

static bool same_size(const ChiaroIoImage *a, const ChiaroIoImage *b)
{
    return a->width == b->width && a->height == b->height;
}

static const char *find_fault(const ChiaroIoImage *test, const ChiaroIoImage *truth, const ChiaroIoImage *mask)
{
    if (!same_size(test, truth))
        return "the pictures are not of one size";
    return mask && !same_size(mask, truth) ? "the mask is not of the pictures' size" : NULL;
}

static int compare_floats(const void *a, const void *b)
{
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

/* What an error is measured in; nothing against nothing is no error. */
static double ratio(double above, double below, double of_nothing)
{
    return below != 0 ? above / below : above != 0 ? INFINITY : of_nothing;
}

bool metrics_compare(const ChiaroIoImage *test, const ChiaroIoImage *truth, const ChiaroIoImage *mask,
                     Metrics *metrics, const char **fault)
{
    *metrics = (Metrics){0};
    if ((*fault = find_fault(test, truth, mask)))
        return false;
    size_t pixels = (size_t)truth->width * truth->height, count = 0;
    float *errors = malloc(pixels * 3 * sizeof *errors);
    if (!errors) {
        *fault = "out of memory";
        return false;
    }
    double squares = 0, truth_squares = 0, sum = 0, truth_sum = 0;
    for (size_t i = 0; i < pixels; i++) {
        Verdict verdict = judge(test, truth, mask, i);
        metrics->mismatched += verdict == MISMATCHED;
        metrics->nonfinite += verdict == NONFINITE;
        metrics->pixels += verdict == COUNTS;
        for (uint32_t c = 0; verdict == COUNTS && c < 3; c++) {
            double a = (double)test->pixels[i * test->channels + c];
            double b = (double)truth->pixels[i * truth->channels + c];
            squares += (a - b) * (a - b), truth_squares += b * b;
            sum += a, truth_sum += b;
            errors[count++] = (float)fabs(a - b);
        }
    }
    qsort(errors, count, sizeof *errors, compare_floats);
    double mean = count ? truth_sum / (double)count : 0;
    metrics->relrmse = sqrt(ratio(squares, truth_squares, 0));
    metrics->mean_ratio = ratio(sum, truth_sum, 1);
    if (count) {
        /* The smallest error that at least 99 % do not exceed. */
        metrics->p99 = ratio((double)errors[(count * 99 + 99) / 100 - 1], mean, 0);
        metrics->max = ratio((double)errors[count - 1], mean, 0);
    }
    free(errors);
    return true;
}

void metrics_scale_best(const ChiaroIoImage *truth, ChiaroIoImage *picture)
{
    double along = 0, size = 0;
    size_t count = (size_t)picture->width * picture->height;
    for (size_t i = 0; i < count; i++) {
        for (size_t c = 0; c < 3 && picture->pixels[4 * i + 3] > 0 && truth->pixels[4 * i + 3] > 0; c++) {
            along += (double)picture->pixels[4 * i + c] * (double)truth->pixels[4 * i + c];
            size += (double)picture->pixels[4 * i + c] * (double)picture->pixels[4 * i + c];
        }
    }
    for (size_t i = 0; size > 0 && i < count; i++) {
        for (size_t c = 0; c < 3; c++)
            picture->pixels[4 * i + c] = (float)((double)picture->pixels[4 * i + c] * along / size);
    }
}

static double mean_of(const ChiaroIoImage *test, const ChiaroIoImage *truth, const ChiaroIoImage *mask)
{
    double sum = 0, count = 0;
    for (size_t i = 0, n = (size_t)truth->width * truth->height; i < n; i++) {
        if (judge(test, truth, mask, i) != COUNTS)
            continue;
        const float *b = truth->pixels + i * truth->channels;
        sum += ((double)b[0] + (double)b[1] + (double)b[2]) / 3;
        count++;
    }
    return count > 0 ? sum / count : 0;
}

bool metrics_picture(const ChiaroIoImage *test, const ChiaroIoImage *truth, const ChiaroIoImage *mask,
                     ChiaroIoImage *picture, const char **fault)
{
    *picture = (ChiaroIoImage){.width = truth->width, .height = truth->height, .channels = 3};
    if ((*fault = find_fault(test, truth, mask)))
        return false;
    size_t pixels = (size_t)truth->width * truth->height;
    picture->pixels = malloc(pixels * 3 * sizeof(float));
    if (!picture->pixels) {
        *fault = "out of memory";
        return false;
    }
    double full = PICTURE_RANGE * mean_of(test, truth, mask);
    for (size_t i = 0; i < pixels; i++) {
        const float *a = test->pixels + i * test->channels, *b = truth->pixels + i * truth->channels;
        float *out = picture->pixels + i * 3;
        Verdict verdict = judge(test, truth, mask, i);
        out[0] = out[1] = out[2] = 0.2f;
        if (verdict == NONFINITE || verdict == MISMATCHED) {
            out[0] = verdict == NONFINITE ? 1 : 0;
            out[1] = 1;
            out[2] = 0;
        } else if (verdict == COUNTS) {
            double error = ((double)a[0] - b[0] + (double)a[1] - b[1] + (double)a[2] - b[2]) / 3;
            float share = (float)fmin(ratio(fabs(error), full, 0), 1);
            out[0] = error > 0 ? share : 0;
            out[1] = 0;
            out[2] = error < 0 ? share : 0;
        }
    }
    return true;
}

static int compare_doubles(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

void metrics_sort(double *values, size_t count) { qsort(values, count, sizeof *values, compare_doubles); }
