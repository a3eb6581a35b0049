/* Loaded before a program that is built with the address sanitizer: what it loads itself, drivers and layers, stays
 * until leaks are looked for, so that each can be told from ours by the name of its library (leak.supp). */
int dlclose(void *handle);

int dlclose(void *handle)
{
    (void)handle;
    return 0;
}
