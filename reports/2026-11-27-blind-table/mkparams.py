NAMES="""mx my mrot_a mrot_b kb_a kb_b cb_a cb_b gap_a gap_b
fcx fsx vsx fvx fqx z0x asx fcy fsy vsy fvy fqy z0y asy
fma fmb fva fvb z0m
cog_a cog_b cogN_a cogN_b cogph_a cogph_b
kp_a kp_b ki_a ki_b tlim_a tlim_b tau_cur pll gain_a gain_b off_a off_b delay_a delay_b lag slew vmax dead
encstep ecc_a ecc_b eccph
tiltx tilty xcm xcd posfr posL therm thermT loadfr
ms km d0 cm fst z0s
sag sagT
hostkp hostvmax pushT pushD pushFx pushFy""".split()
if __name__=="__main__":
    with open("params.h","w") as f:
        f.write("enum {"+",".join("P_"+n for n in NAMES)+",P_N};\n")
